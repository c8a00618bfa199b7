/* Twin of link_classes.py. Boxes and buildings whose circle a line of sight does not reach are passed over. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "../core/compiled/values.h"
#include "../core/portable.h"
#include "../v2x/radio/link_class.h"

enum { BLOCKER_NUMBERS = 6 };

/* A line of sight: its begin, its way, and its length. */
typedef struct {
    double x, y, dx, dy, length;
} Ray;

/* More than rounding moves what a circle bounds [m]. */
static const double MARGIN_M = 1e-3;

typedef struct {
    double x, y, half_length, half_width, top;
    CosSin yaw;
} Blocker;

/* Boxes that block; their circles are columns, which a processor tests several at a time. */
typedef struct {
    Py_ssize_t count;
    Blocker *boxes;
    double *x, *y, *reach;
    Py_ssize_t *rows;
    unsigned char *reached; /* and zeros up to a whole word */
    double highest; /* of their tops */
} Blockers;

static bool reaches_circle(const Ray *ray, double x, double y, double radius) {
    double px = x - ray->x, py = y - ray->y, most = (radius + MARGIN_M) * ray->length;
    double along = px * ray->dx + py * ray->dy, aside = px * ray->dy - py * ray->dx;
    return !(aside > most || -aside > most || -along > most || along - ray->length * ray->length > most);
}

static bool crosses_box(const Ray *ray, const Blocker *box) {
    double px = ray->x - box->x, py = ray->y - box->y, since = 0.0, until = 1.0;
    double starts[] = {box->yaw.cos * px + box->yaw.sin * py, box->yaw.cos * py - box->yaw.sin * px};
    double ways[] = {box->yaw.cos * ray->dx + box->yaw.sin * ray->dy, box->yaw.cos * ray->dy - box->yaw.sin * ray->dx};
    double halves[] = {box->half_length, box->half_width};
    for (int i = 0; i < 2; i++) {
        if (ways[i] == 0.0) {
            if (!(fabs(starts[i]) < halves[i])) return false;
            continue;
        }
        double first = (-halves[i] - starts[i]) / ways[i], last = (halves[i] - starts[i]) / ways[i];
        if (last < first) {
            double other = first;
            first = last;
            last = other;
        }
        if (first > since) since = first;
        if (last < until) until = last;
    }
    return since < until;
}

static bool are_apart(double a, double b) { return (a < 0.0 && 0.0 < b) || (b < 0.0 && 0.0 < a); }

static bool crosses_wall(const Ray *ray, double to_x, double to_y, const double *wall) {
    double begin = ray->dx * (wall[1] - ray->y) - ray->dy * (wall[0] - ray->x);
    double end = ray->dx * (wall[3] - ray->y) - ray->dy * (wall[2] - ray->x);
    if (!are_apart(begin, end)) return false;
    double ex = wall[2] - wall[0], ey = wall[3] - wall[1];
    double near = ex * (ray->y - wall[1]) - ey * (ray->x - wall[0]);
    double far = ex * (to_y - wall[1]) - ey * (to_x - wall[0]);
    return are_apart(near, far);
}

static bool crosses_building(const Ray *ray, const double *to, const double *walls, const int64_t *ends,
                             const double *circles, Py_ssize_t buildings) {
    for (Py_ssize_t b = 0; b < buildings; b++) {
        const double *circle = circles + 3 * b;
        if (!reaches_circle(ray, circle[0], circle[1], circle[2])) continue;
        for (int64_t k = b ? ends[b - 1] : 0; k < ends[b]; k++)
            if (crosses_wall(ray, to[0], to[1], walls + 4 * k)) return true;
    }
    return false;
}

static void close_blockers(Blockers *all) {
    free(all->boxes);
    free(all->x);
    free(all->rows);
    free(all->reached);
}

static bool open_blockers(const Array *array, Blockers *all) {
    Py_ssize_t most = array->shape[0];
    double *numbers = malloc((3 * most + 1) * sizeof *numbers);
    *all = (Blockers){0, malloc((most + 1) * sizeof *all->boxes), numbers, numbers + most, numbers + 2 * most,
                      malloc((most + 1) * sizeof *all->rows), calloc(most + sizeof(uint64_t), 1), 0.0};
    bool is_valid = all->boxes && numbers && all->rows && all->reached;
    if (!is_valid) PyErr_NoMemory();
    for (Py_ssize_t i = 0; is_valid && i < most; i++) {
        const double *row = doubles(array) + BLOCKER_NUMBERS * i;
        CosSin yaw = cos_sin(row[2]);
        if (isnan(yaw.cos)) {
            PyErr_SetString(PyExc_ValueError, "expected finite yaws of boxes");
            is_valid = false;
        }
        if (!(row[5] > 0.0)) continue;
        double length = row[3] / 2, width = row[4] / 2;
        Py_ssize_t n = all->count++;
        all->boxes[n] = (Blocker){row[0], row[1], length, width, row[5], yaw};
        all->x[n] = row[0];
        all->y[n] = row[1];
        all->reach[n] = sqrt(length * length + width * width) + MARGIN_M;
        all->rows[n] = i;
        if (row[5] > all->highest) all->highest = row[5];
    }
    if (!is_valid) close_blockers(all);
    return is_valid;
}

static double find_top(const Ray *ray, const Blockers *all, int64_t carrier, int64_t other) {
    double square = ray->length * ray->length, top = 0.0;
    for (Py_ssize_t i = 0; i < all->count; i++) {
        double px = all->x[i] - ray->x, py = all->y[i] - ray->y, most = all->reach[i] * ray->length;
        double along = px * ray->dx + py * ray->dy, aside = px * ray->dy - py * ray->dx;
        all->reached[i] = !((fabs(aside) > most) | (-along > most) | (along - square > most));
    }
    for (Py_ssize_t first = 0; first < all->count && top < all->highest; first += sizeof(uint64_t)) {
        uint64_t word;
        memcpy(&word, all->reached + first, sizeof word);
        for (; word; word &= word - 1) {
            Py_ssize_t i = first + __builtin_ctzll(word) / 8;
            if (all->boxes[i].top > top && all->rows[i] != carrier && all->rows[i] != other &&
                crosses_box(ray, all->boxes + i))
                top = all->boxes[i].top;
        }
    }
    return top;
}

static bool are_buildings_valid(const Array *walls, const Array *ends, const Array *circles) {
    bool is_valid = walls->shape[1] == 4 && circles->shape[1] == 3 && circles->shape[0] == ends->count;
    const int64_t *end = ends->data;
    for (Py_ssize_t i = 0; is_valid && i < ends->count; i++)
        is_valid = end[i] >= (i ? end[i - 1] : 0) && end[i] <= walls->shape[0];
    return is_valid;
}

enum { PLACES, CARRIERS, BLOCKERS, WALLS, ENDS, CIRCLES, ARRAYS };

static void fill_links(const Array *arrays, Py_ssize_t count, const Blockers *boxes, unsigned char *classes,
                       double *tops) {
    Py_ssize_t stations = arrays[PLACES].shape[0];
    const double *places = doubles(arrays + PLACES);
    const int64_t *carriers = arrays[CARRIERS].data;
    for (Py_ssize_t i = 0; i < count; i++) {
        classes[i * stations + i] = LOS;
        tops[i * stations + i] = 0.0;
        for (Py_ssize_t k = i + 1; k < stations; k++) {
            const double *from = places + 2 * i, *to = places + 2 * k;
            Ray ray = {from[0], from[1], to[0] - from[0], to[1] - from[1], 0.0};
            ray.length = sqrt(ray.dx * ray.dx + ray.dy * ray.dy);
            bool is_hidden = crosses_building(&ray, to, doubles(arrays + WALLS), arrays[ENDS].data,
                                              doubles(arrays + CIRCLES), arrays[ENDS].count);
            double top = is_hidden ? 0.0 : find_top(&ray, boxes, carriers[i], carriers[k]);
            unsigned char kind = is_hidden ? NLOSB : top > 0.0 ? NLOSV : LOS;
            classes[i * stations + k] = kind;
            tops[i * stations + k] = top;
            if (k < count) {
                classes[k * stations + i] = kind;
                tops[k * stations + i] = top;
            }
        }
    }
}

static PyObject *sensing_link_classes_classify_links(PyObject *module, PyObject *const *arguments, Py_ssize_t given) {
    static const char types[ARRAYS] = {'d', 'l', 'd', 'd', 'l', 'd'};
    static const int dimensions[ARRAYS] = {2, 1, 2, 2, 1, 2};
    static const int places[ARRAYS] = {0, 1, 3, 4, 5, 6};
    Py_ssize_t count;
    if (!expect_arguments("classify_links", given, 7, 7) || !read_integer(arguments[2], &count)) return NULL;
    Array arrays[ARRAYS];
    int opened = 0;
    while (opened < ARRAYS && open_array(arguments[places[opened]], types[opened], arrays + opened)) opened++;
    bool is_valid = opened == ARRAYS;
    for (int i = 0; is_valid && i < ARRAYS; i++) is_valid = arrays[i].dimensions == dimensions[i];
    is_valid = is_valid && arrays[PLACES].shape[1] == 2 && arrays[CARRIERS].count == arrays[PLACES].shape[0] &&
               arrays[BLOCKERS].shape[1] == BLOCKER_NUMBERS && count >= 0 && count <= arrays[PLACES].shape[0] &&
               are_buildings_valid(arrays + WALLS, arrays + ENDS, arrays + CIRCLES);
    if (!is_valid && !PyErr_Occurred()) PyErr_SetString(PyExc_ValueError, "expected stations, boxes and walls of buildings");
    PyObject *classes = NULL, *tops = NULL;
    Blockers boxes;
    if (is_valid && open_blockers(arrays + BLOCKERS, &boxes)) {
        Py_ssize_t shape[] = {count, arrays[PLACES].shape[0]};
        void *kinds, *heights;
        classes = new_array('B', 2, shape, &kinds);
        tops = classes ? new_array('d', 2, shape, &heights) : NULL;
        if (tops) fill_links(arrays, count, &boxes, kinds, heights);
        close_blockers(&boxes);
    }
    while (opened--) close_array(arrays + opened);
    if (tops) return pack(2, classes, tops);
    if (classes) Py_DecRef(classes);
    return NULL;
}

Functions sensing_link_classes = {
    FUNCTION(sensing_link_classes_classify_links),
    END_OF_FUNCTIONS,
};
