/* Twin of min_pet.py. The reference looks at all pairs of frames with one lag after another; here blocks of frames whose
   places are far apart are left out, and the least lag so far bounds the search. */
#include <stdlib.h>

#include "frames.h"

enum { LAGS = 50, BLOCK = 8 };
static const double MIN_TURN = 30.0 * (PI / 180.0), SLACK_M = 1e-3; /* SLACK_M: rounding leaves no near block out */

typedef struct {
    double low_x, low_y, high_x, high_y;
} Bounds;

/* The centres of a road user in a block of frames. */
static Bounds compute_bounds(const Frames *frames, Py_ssize_t block, Py_ssize_t column) {
    Bounds bounds = {INFINITY, INFINITY, -INFINITY, -INFINITY};
    for (Py_ssize_t i = block * BLOCK; i < (block + 1) * BLOCK && i < frames->frames; i++) {
        if (!is_valid(frames, i, column)) continue;
        double x = doubles(&frames->x)[i * frames->columns + column], y = doubles(&frames->y)[i * frames->columns + column];
        bounds = (Bounds){least(x, bounds.low_x), least(y, bounds.low_y), greatest(x, bounds.high_x),
                          greatest(y, bounds.high_y)};
    }
    return bounds;
}

static bool are_near(const Bounds *one, const Bounds *other, double reach) {
    double x = greatest(one->low_x - other->high_x, other->low_x - one->high_x);
    double y = greatest(one->low_y - other->high_y, other->low_y - one->high_y);
    return x < reach + SLACK_M && y < reach + SLACK_M;
}

typedef struct {
    const Frames *frames;
    Py_ssize_t column, least_lag; /* LAGS + 1 as long as there is none */
    double across;                /* the cosine of the least turn */
    bool is_refused;
} Search;

static void compare_frames(Search *search, Py_ssize_t first, Py_ssize_t second, Py_ssize_t other, double reach) {
    const Frames *frames = search->frames;
    Py_ssize_t one = first * frames->columns + search->column, two = second * frames->columns + other;
    double x = doubles(&frames->x)[two] - doubles(&frames->x)[one], y = doubles(&frames->y)[two] - doubles(&frames->y)[one];
    if (!(x * x + y * y < reach * reach)) return;
    double turn = cos_sin(doubles(&frames->yaw)[two] - doubles(&frames->yaw)[one]).cos;
    if (!isfinite(turn)) search->is_refused = true;
    if (!(turn <= search->across)) return;
    Box own = get_box(frames, first, search->column), theirs = get_box(frames, second, other);
    if (boxes_overlap(&own, &theirs)) search->least_lag = first < second ? second - first : first - second;
}

static void compare_blocks(Search *search, Py_ssize_t first, Py_ssize_t second, Py_ssize_t other, double reach) {
    Py_ssize_t count = search->frames->frames;
    for (Py_ssize_t i = first * BLOCK; i < (first + 1) * BLOCK && i < count; i++) {
        if (!is_valid(search->frames, i, search->column)) continue;
        for (Py_ssize_t j = second * BLOCK; j < (second + 1) * BLOCK && j < count; j++)
            if (i - j < search->least_lag && j - i < search->least_lag && is_valid(search->frames, j, other))
                compare_frames(search, i, j, other, reach);
    }
}

static void search_column(Search *search, const Bounds *own, Bounds *theirs, Py_ssize_t blocks, Py_ssize_t other) {
    double reach = get_radius(search->frames, other) + get_radius(search->frames, search->column);
    for (Py_ssize_t i = 0; i < blocks; i++) theirs[i] = compute_bounds(search->frames, i, other);
    for (Py_ssize_t i = 0; i < blocks; i++) {
        Py_ssize_t last = i + LAGS / BLOCK + 1;
        for (Py_ssize_t j = i > LAGS / BLOCK + 1 ? i - LAGS / BLOCK - 1 : 0; j <= last && j < blocks; j++)
            if (are_near(own + i, theirs + j, reach)) compare_blocks(search, i, j, other, reach);
    }
}

static PyObject *scoring_metrics_min_pet__find_least_lag(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    Frames frames;
    Search search = {&frames, 0, LAGS + 1, cos_sin(MIN_TURN).cos, false};
    if (!expect_arguments("_find_least_lag", count, 7, 7) || !open_frames(arguments, false, &frames, &search.column))
        return NULL;
    Py_ssize_t blocks = (frames.frames + BLOCK - 1) / BLOCK;
    Bounds *own = malloc((2 * blocks + 1) * sizeof *own);
    for (Py_ssize_t i = 0; own && i < blocks; i++) own[i] = compute_bounds(&frames, i, search.column);
    for (Py_ssize_t other = search.column + 1; own && other < frames.columns && search.least_lag; other++)
        search_column(&search, own, own + blocks, blocks, other);
    close_frames(&frames);
    free(own);
    if (!own) return PyErr_NoMemory();
    if (search.is_refused) return refuse_numbers("_find_least_lag");
    return search.least_lag > LAGS ? new_reference(Py_None) : PyLong_FromSsize_t(search.least_lag);
}

Functions scoring_metrics_min_pet = {
    FUNCTION(scoring_metrics_min_pet__find_least_lag),
    END_OF_FUNCTIONS,
};
