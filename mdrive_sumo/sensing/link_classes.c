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

typedef struct {
    double x, y, half_length, half_width, top;
    CosSin yaw;
} Blocker;

/* Circles round what may block, as a station sees them. Whether a line reaches them is computed roughly, several at a
   time; the margin is more than rounding moves them. */
typedef struct {
    Py_ssize_t count;
    const double **circles; /* x, y, radius [m] of each */
    float *x, *y, *reach;   /* from the station */
    unsigned char *reached; /* by the present line; and zeros up to a whole word */
} Circles;

typedef struct {
    Py_ssize_t count;
    Blocker *boxes;
    double *circles;
    Py_ssize_t *rows;
    double highest; /* of their tops */
} Blockers;

static void close_circles(Circles *all) {
    free(all->circles);
    free(all->x);
    free(all->reached);
}

static bool open_circles(Circles *all, const double *circles, Py_ssize_t count) {
    float *numbers = malloc((3 * count + 1) * sizeof *numbers);
    *all = (Circles){count, malloc((count + 1) * sizeof *all->circles), numbers, numbers + count, numbers + 2 * count,
                     calloc(count + sizeof(uint64_t), 1)};
    if (!all->circles || !numbers || !all->reached) {
        close_circles(all);
        PyErr_NoMemory();
        return false;
    }
    for (Py_ssize_t i = 0; i < count; i++) all->circles[i] = circles + 3 * i;
    return true;
}

static void approach(Circles *all, const double *station) {
    for (Py_ssize_t i = 0; i < all->count; i++) {
        double px = all->circles[i][0] - station[0], py = all->circles[i][1] - station[1];
        all->x[i] = (float)px;
        all->y[i] = (float)py;
        all->reach[i] = (float)(all->circles[i][2] + 1e-2 + 1e-6 * (fabs(px) + fabs(py)));
    }
}

static void mark_reached(Circles *all, const Ray *ray) {
    float ux = (float)(ray->dx / ray->length), uy = (float)(ray->dy / ray->length), length = (float)ray->length;
    const float *restrict x = all->x, *restrict y = all->y, *restrict reach = all->reach;
    unsigned char *restrict reached = all->reached;
    for (Py_ssize_t i = 0; i < all->count; i++) {
        float along = x[i] * ux + y[i] * uy, aside = x[i] * uy - y[i] * ux;
        reached[i] = !((fabsf(aside) > reach[i]) | (-along > reach[i]) | (along - length > reach[i]));
    }
}

/* The first circle from `first` on that is reached; `count` if there is none. */
static Py_ssize_t find_reached(const Circles *all, Py_ssize_t first) {
    for (; first < all->count; first += sizeof(uint64_t)) {
        uint64_t word;
        memcpy(&word, all->reached + first, sizeof word);
        if (word) return first + __builtin_ctzll(word) / 8;
    }
    return all->count;
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
                             Circles *buildings) {
    mark_reached(buildings, ray);
    for (Py_ssize_t b = find_reached(buildings, 0); b < buildings->count; b = find_reached(buildings, b + 1))
        for (int64_t k = b ? ends[b - 1] : 0; k < ends[b]; k++)
            if (crosses_wall(ray, to[0], to[1], walls + 4 * k)) return true;
    return false;
}

static void close_blockers(Blockers *all) {
    free(all->boxes);
    free(all->circles);
    free(all->rows);
}

static bool open_blockers(const Array *array, Blockers *all) {
    Py_ssize_t most = array->shape[0];
    *all = (Blockers){0, malloc((most + 1) * sizeof *all->boxes), malloc((3 * most + 1) * sizeof *all->circles),
                      malloc((most + 1) * sizeof *all->rows), 0.0};
    bool is_valid = all->boxes && all->circles && all->rows;
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
        memcpy(all->circles + 3 * n, (double[]){row[0], row[1], sqrt(length * length + width * width)},
               3 * sizeof(double));
        all->rows[n] = i;
        if (row[5] > all->highest) all->highest = row[5];
    }
    if (!is_valid) close_blockers(all);
    return is_valid;
}

static double find_top(const Ray *ray, const Blockers *all, Circles *circles, int64_t carrier, int64_t other) {
    double top = 0.0;
    mark_reached(circles, ray);
    for (Py_ssize_t i = find_reached(circles, 0); i < all->count && top < all->highest; i = find_reached(circles, i + 1))
        if (all->boxes[i].top > top && all->rows[i] != carrier && all->rows[i] != other &&
            crosses_box(ray, all->boxes + i))
            top = all->boxes[i].top;
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

static void fill_links(const Array *arrays, Py_ssize_t count, const Blockers *boxes, Circles *round_boxes,
                       Circles *buildings, unsigned char *classes, double *tops) {
    Py_ssize_t stations = arrays[PLACES].shape[0];
    const double *places = doubles(arrays + PLACES);
    const int64_t *carriers = arrays[CARRIERS].data;
    for (Py_ssize_t i = 0; i < count; i++) {
        const double *from = places + 2 * i;
        approach(round_boxes, from);
        approach(buildings, from);
        classes[i * stations + i] = LOS;
        tops[i * stations + i] = 0.0;
        for (Py_ssize_t k = i + 1; k < stations; k++) {
            const double *to = places + 2 * k;
            Ray ray = {from[0], from[1], to[0] - from[0], to[1] - from[1], 0.0};
            ray.length = sqrt(ray.dx * ray.dx + ray.dy * ray.dy);
            bool is_hidden = crosses_building(&ray, to, doubles(arrays + WALLS), arrays[ENDS].data, buildings);
            double top = is_hidden ? 0.0 : find_top(&ray, boxes, round_boxes, carriers[i], carriers[k]);
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

static PyObject *make_links(const Array *arrays, Py_ssize_t count) {
    Blockers boxes;
    Circles round_boxes = {0}, buildings = {0};
    if (!open_blockers(arrays + BLOCKERS, &boxes)) return NULL;
    PyObject *classes = NULL, *tops = NULL;
    if (open_circles(&round_boxes, boxes.circles, boxes.count)) {
        if (open_circles(&buildings, doubles(arrays + CIRCLES), arrays[CIRCLES].shape[0])) {
            Py_ssize_t shape[] = {count, arrays[PLACES].shape[0]};
            void *kinds, *heights;
            classes = new_array('B', 2, shape, &kinds);
            tops = classes ? new_array('d', 2, shape, &heights) : NULL;
            if (tops) fill_links(arrays, count, &boxes, &round_boxes, &buildings, kinds, heights);
            close_circles(&buildings);
        }
        close_circles(&round_boxes);
    }
    close_blockers(&boxes);
    if (tops) return pack(2, classes, tops);
    if (classes) Py_DecRef(classes);
    return NULL;
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
    PyObject *links = is_valid ? make_links(arrays, count) : NULL;
    while (opened--) close_array(arrays + opened);
    return links;
}

Functions sensing_link_classes = {
    FUNCTION(sensing_link_classes_classify_links),
    END_OF_FUNCTIONS,
};
