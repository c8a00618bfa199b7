/* Twin of bounded_trajectory.py: the iterations of the solver. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "../../mdrive_sumo/core/compiled/values.h"

static const double RELATIVE_TOLERANCE = 0.01, RELAXATION = 1.7;
enum { MAX_ITERATIONS = 400, CHECK_INTERVAL = 10 };

/* Two numbers that are computed at a time. */
typedef double Pair __attribute__((vector_size(16)));

static inline Pair load(const double *numbers) {
    Pair pair;
    memcpy(&pair, numbers, sizeof pair);
    return pair;
}

enum { ROWS = 4 }; /* at a time: a sum waits for its last addition, so several are under way */

enum { EIGHT = 8 };

/* Columns outside which a row has zeros only, which change no sum; `first` is a multiple of eight. */
typedef struct {
    Py_ssize_t first, end;
} Band;

static void find_bands(const double *matrix, Py_ssize_t rows, Py_ssize_t columns, Band *bands) {
    for (Py_ssize_t i = 0; i < rows; i++, matrix += columns) {
        Py_ssize_t first = 0, end = columns;
        while (first < columns && matrix[first] == 0.0) first++;
        while (end > first && matrix[end - 1] == 0.0) end--;
        Py_ssize_t whole = (end + EIGHT - 1) / EIGHT * EIGHT;
        bands[i] = (Band){first / EIGHT * EIGHT, whole < columns ? whole : columns};
    }
}

/* The products of ROWS rows, or of one, of a matrix (M, columns) with two vectors, in a band of all of them. Inlined
   with a known number of rows, so that the sums are in registers. */
__attribute__((always_inline)) static inline void multiply_rows(const double *matrix, Py_ssize_t columns, Band band, int rows,
                          const double *const vectors[2], double *const products[2]) {
    Pair sums[ROWS][2] = {0};
    Py_ssize_t j = band.first;
    for (; j + EIGHT <= band.end; j += EIGHT)
#pragma clang loop unroll(full)
        for (int k = EIGHT - 2; k >= 0; k -= 2)
#pragma clang loop unroll(full)
            for (int i = 0; i < rows; i++) {
                Pair row = load(matrix + i * columns + j + k);
                sums[i][0] += row * load(vectors[0] + j + k);
                sums[i][1] += row * load(vectors[1] + j + k);
            }
    for (; j < band.end; j += 2)
        for (int i = 0; i < rows; i++)
            for (int v = 0; v < 2; v++) {
                sums[i][v][0] += matrix[i * columns + j] * vectors[v][j];
                if (j + 1 < columns) sums[i][v][1] += matrix[i * columns + j + 1] * vectors[v][j + 1];
            }
    for (int i = 0; i < rows; i++)
        for (int v = 0; v < 2; v++) products[v][i] = sums[i][v][0] + sums[i][v][1];
}

/* The products (2, rows) of a matrix (rows, columns) with vectors (2, columns). `bands`: of its rows, NULL: all. */
static void multiply(const double *matrix, const Band *bands, Py_ssize_t rows, Py_ssize_t columns,
                     const double *vectors, double *products) {
    const double *const both[2] = {vectors, vectors + columns};
    Band all = {0, columns};
    Py_ssize_t i = 0;
    for (; !bands && i + ROWS <= rows; i += ROWS)
        multiply_rows(matrix + i * columns, columns, all, ROWS, both, (double *[2]){products + i, products + rows + i});
    for (; i < rows; i++)
        multiply_rows(matrix + i * columns, columns, bands ? bands[i] : all, 1, both,
                      (double *[2]){products + i, products + rows + i});
}

/* A problem of T frames with N constrained quantities. */
typedef struct {
    Py_ssize_t frames, count;
    const double *wanted, *rows, *inverse, *pull, *ahead;
    const char *still;
} Problem;

static inline double at_least_one(double size) { return size > 1.0 || isnan(size) ? size : 1.0; }

static void project(const Problem *problem, const double *values, double *result) {
    Py_ssize_t count = problem->count, steps = count - (problem->frames - 1);
    const double *x = values, *y = values + count, *cos = problem->ahead, *sin = problem->ahead + problem->frames - 1;
    for (Py_ssize_t i = 0; i < steps; i++) {
        double size = at_least_one(hypot(x[i], y[i]));
        result[i] = x[i] / size, result[count + i] = y[i] / size;
    }
    for (Py_ssize_t i = steps, k = 0; i < count; i++, k++) {
        double along = x[i] * cos[k] + y[i] * sin[k], backward = along < 0.0 || isnan(along) ? along : 0.0;
        result[i] = problem->still[k] ? 0.0 : x[i] - backward * cos[k];
        result[count + i] = problem->still[k] ? 0.0 : y[i] - backward * sin[k];
    }
}

static bool is_met(const double *found, const double *wanted, Py_ssize_t count) {
    for (Py_ssize_t i = 0; i < count; i++)
        if (!(fabs(found[i] - wanted[i]) < RELATIVE_TOLERANCE)) return false;
    return true;
}

/* Leaves the positions (2, T) in p; `work` has room for four arrays (2, N) and one (2, T). */
static void solve(const Problem *problem, const Band *bands, double *work, double *p) {
    Py_ssize_t frames = problem->frames, count = problem->count, both = 2 * count;
    double *y = work, *u = y + both, *found = u + both, *other = found + both, *free_ = other + both;
    multiply(problem->inverse, NULL, frames, frames, problem->wanted, free_);
    memcpy(p, problem->wanted, 2 * frames * sizeof *p);
    multiply(problem->rows, bands, count, frames, p, other);
    project(problem, other, y);
    memset(u, 0, both * sizeof *u);
    for (int k = 0; k < MAX_ITERATIONS; k++) {
        for (Py_ssize_t i = 0; i < both; i++) other[i] = y[i] - u[i];
        multiply(problem->pull, NULL, frames, count, other, p);
        for (Py_ssize_t i = 0; i < 2 * frames; i++) p[i] = free_[i] + p[i];
        multiply(problem->rows, bands, count, frames, p, found);
        if (k % CHECK_INTERVAL == CHECK_INTERVAL - 1 && is_met(found, y, both)) return;
        for (Py_ssize_t i = 0; i < both; i++) {
            double now = RELAXATION * found[i] + (1 - RELAXATION) * y[i];
            other[i] = now + u[i];
            u[i] = u[i] + now;
        }
        project(problem, other, y);
        for (Py_ssize_t i = 0; i < both; i++) u[i] = u[i] - y[i];
    }
}

enum { WANTED, MATRIX, INVERSE, PULL, AHEAD, STILL, ARRAYS };

static PyObject *solve_arrays(const Array *arrays) {
    Problem problem = {
        arrays[INVERSE].shape[0], arrays[MATRIX].shape[0], arrays[WANTED].data, arrays[MATRIX].data,
        arrays[INVERSE].data, arrays[PULL].data, arrays[AHEAD].data, arrays[STILL].data,
    };
    Py_ssize_t frames = problem.frames, count = problem.count;
    const Py_ssize_t wanted[ARRAYS][2] = {
        {2, frames}, {count, frames}, {frames, frames}, {frames, count}, {2, frames - 1}, {frames - 1, 1},
    };
    bool are_usable = frames > 1 && count >= frames - 1;
    for (int k = 0; are_usable && k < ARRAYS; k++)
        are_usable = arrays[k].shape[0] == wanted[k][0] && (k == STILL || arrays[k].shape[1] == wanted[k][1]);
    if (!are_usable) {
        PyErr_SetString(PyExc_ValueError, "expected arrays of T frames and N quantities");
        return NULL;
    }
    double *p, *work = malloc((8 * count + 2 * frames) * sizeof *work);
    Band *bands = malloc(count * sizeof *bands);
    PyObject *result = work && bands ? new_doubles(2, (Py_ssize_t[]){2, frames}, &p) : PyErr_NoMemory();
    if (result) {
        find_bands(problem.rows, count, frames, bands);
        solve(&problem, bands, work, p);
    }
    free(work);
    free(bands);
    return result;
}

static PyObject *real2sim_tracks_bounded_trajectory__solve(PyObject *module, PyObject *const *arguments,
                                                           Py_ssize_t count) {
    if (!expect_arguments("_solve", count, ARRAYS, ARRAYS)) return NULL;
    Array arrays[ARRAYS];
    int opened = 0;
    bool are_usable = true;
    for (; are_usable && opened < ARRAYS; opened += are_usable) {
        Array *array = arrays + opened;
        are_usable = open_array(arguments[opened], opened == STILL ? '?' : 'd', array);
        if (are_usable && array->dimensions != (opened == STILL ? 1 : 2)) {
            PyErr_SetString(PyExc_ValueError, "expected matrices, and a row of truth values");
            close_array(array);
            are_usable = false;
        }
    }
    PyObject *result = are_usable ? solve_arrays(arrays) : NULL;
    for (int k = 0; k < opened; k++) close_array(arrays + k);
    return result;
}

Functions real2sim_tracks_bounded_trajectory = {
    FUNCTION(real2sim_tracks_bounded_trajectory__solve),
    END_OF_FUNCTIONS,
};
