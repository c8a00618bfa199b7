/* Twin of lidar_cast.py: the first hit of every ray of a scan. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "../core/geometry.h"

static const double EDGE_SLACK = 1e-9, TOUCH_M = 1e-9;
static const int CORNERS[2][4] = {{1, -1, -1, 1}, {1, 1, -1, -1}};
FIELDS(RAYS, "azimuth", "across", "climb", "order", "shared");
FIELDS(BOXES, "x", "y", "yaw", "length", "width", "top", "owner");
FIELDS(WALLS, "start", "end", "owner", "top");

/* Rays as in lidar_rays.LidarRays. */
typedef struct {
    Array azimuth, across, climb, order;
    Py_ssize_t columns, channels; /* one channel if every ray is a column of its own */
    bool shared;
} Rays;

/* Opens the first fields as arrays of these kinds, one letter each. */
static bool open_fields(PyObject *object, Fields *fields, const char *kinds, Array *const *arrays) {
    for (int i = 0; kinds[i]; i++) {
        PyObject *field = get_field(object, fields, i);
        bool is_open = field && open_array(field, kinds[i], arrays[i]);
        if (field) Py_DecRef(field);
        if (!is_open) {
            close_arrays(i, arrays);
            return false;
        }
    }
    return true;
}

static bool refuse(const char *text) {
    PyErr_SetString(PyExc_ValueError, text);
    return false;
}

static void close_rays(Rays *rays) {
    close_arrays(4, (Array *[]){&rays->azimuth, &rays->across, &rays->climb, &rays->order});
}

static bool check_rays(const Rays *rays) {
    const int64_t *order = rays->order.data;
    Py_ssize_t count = rays->order.count;
    if (rays->azimuth.dimensions != 1 || rays->climb.dimensions != 1 || rays->across.count != 2 * rays->columns ||
        count != rays->columns * rays->channels || (!rays->shared && rays->climb.count != rays->columns))
        return refuse("expected as many rays as columns times channels");
    for (Py_ssize_t i = 0; !rays->shared && i < count; i++)
        if (order[i] < 0 || order[i] >= count) return refuse("expected an order of rays within their number");
    return true;
}

static bool open_rays(PyObject *object, Rays *rays) {
    Array *arrays[] = {&rays->azimuth, &rays->across, &rays->climb, &rays->order};
    PyObject *shared = get_field(object, &RAYS, 4);
    int is_shared = shared ? PyObject_IsTrue(shared) : -1;
    if (shared) Py_DecRef(shared);
    if (is_shared < 0 || !open_fields(object, &RAYS, "dddl", arrays)) return false;
    rays->shared = is_shared;
    rays->columns = rays->azimuth.count;
    rays->channels = is_shared ? rays->climb.count : 1;
    if (check_rays(rays)) return true;
    close_rays(rays);
    return false;
}

/* As numpy.searchsorted: what is not a number comes last. */
static Py_ssize_t search_left(const double *values, Py_ssize_t count, double value) {
    Py_ssize_t low = 0;
    while (low < count) {
        Py_ssize_t middle = (low + count) / 2;
        if (values[middle] < value || isnan(value)) low = middle + 1;
        else count = middle;
    }
    return low;
}

static Py_ssize_t search_right(const double *values, Py_ssize_t count, double value) {
    Py_ssize_t low = 0;
    while (low < count) {
        Py_ssize_t middle = (low + count) / 2;
        if (value < values[middle]) count = middle;
        else low = middle + 1;
    }
    return low;
}

/* Columns from `first` on, around the circle. */
typedef struct {
    Py_ssize_t first, count;
} Columns;

static bool find_first(const Rays *rays, double angle, Py_ssize_t *first) {
    double turn = floor(angle / TAU);
    if (!(fabs(turn) < 1e6)) return refuse("expected finite places of boxes and walls");
    *first = search_left(doubles(&rays->azimuth), rays->columns, angle - turn * TAU) + (Py_ssize_t)turn * rays->columns;
    return true;
}

/* As _columns. */
static bool find_columns(const Rays *rays, double low, double high, Columns *found) {
    Py_ssize_t first, last;
    if (!find_first(rays, low - EDGE_SLACK, &first) || !find_first(rays, high + EDGE_SLACK, &last)) return false;
    found->count = last - first < rays->columns ? last - first : rays->columns;
    found->first = rays->columns ? (first % rays->columns + rays->columns) % rays->columns : 0;
    return true;
}

/* As pack_keys. */
static int64_t pack_key(double distance, int64_t owner) {
    float narrow = (float)distance;
    int32_t bits;
    memcpy(&bits, &narrow, sizeof bits);
    return (int64_t)((uint64_t)(int64_t)bits << 32) | owner;
}

/* A column that meets something between two horizontal distances. */
typedef struct {
    Py_ssize_t column;
    double near, far, top;
    int64_t owner;
} Intersection;

typedef struct {
    const Rays *rays;
    double height;
    double *nearest; /* (columns,) the nearest wall */
    int64_t *best;   /* (rays,) */
} Scan;

static void keep_least(int64_t *best, int64_t key) {
    if (key < *best) *best = key;
}

/* As _hit_by_columns, of one column. */
static void hit_column(const Scan *scan, Intersection met) {
    const double *climb = doubles(&scan->rays->climb);
    Py_ssize_t channels = scan->rays->channels;
    double near = met.near > TOUCH_M ? met.near : TOUCH_M;
    int64_t *best = scan->best + met.column * channels, key = pack_key(near, met.owner);
    Py_ssize_t foot = search_left(climb, channels, -scan->height / near);
    Py_ssize_t edge = search_right(climb, channels, met.top / near);
    for (Py_ssize_t i = foot; i < edge; i++) keep_least(best + i, key);
    if (!(met.top < 0.0)) return;
    Py_ssize_t end = search_right(climb, channels, met.top / met.far);
    for (Py_ssize_t i = edge; i < end; i++) keep_least(best + i, pack_key(met.top / climb[i], met.owner));
}

/* As _hit_one_by_one, of one ray. */
static void hit_ray(const Scan *scan, Intersection met) {
    double climb = doubles(&scan->rays->climb)[met.column];
    int64_t *best = scan->best + ((const int64_t *)scan->rays->order.data)[met.column];
    if (met.near * climb <= met.top) keep_least(best, pack_key(met.near, met.owner));
    else if (met.near * climb > met.top && met.far * climb <= met.top)
        keep_least(best, pack_key(met.top / climb, met.owner));
}

static void hit(const Scan *scan, Intersection met) {
    if (!(met.near <= scan->nearest[met.column])) return;
    if (scan->rays->shared) hit_column(scan, met);
    else hit_ray(scan, met);
}

typedef struct {
    double x, y, along_x, along_y, area, top;
    int64_t owner;
    Columns columns;
} Wall;

/* As intersect_walls, of one wall: either the nearest walls are found, or hit. */
static void intersect_wall(const Scan *scan, const Wall *wall, bool is_search) {
    const double *across = doubles(&scan->rays->across);
    for (Py_ssize_t i = 0, column = wall->columns.first; i < wall->columns.count; i++, column++) {
        if (column == scan->rays->columns) column = 0;
        double x = across[2 * column], y = across[2 * column + 1];
        double turn = x * wall->along_y - y * wall->along_x, where = wall->x * y - wall->y * x;
        if (!(turn < 0.0 && where <= -EDGE_SLACK * turn && where >= (1 + EDGE_SLACK) * turn)) continue;
        double near = wall->area / turn;
        if (!is_search) hit(scan, (Intersection){column, near, near, wall->top, wall->owner});
        else if (near < scan->nearest[column]) scan->nearest[column] = near;
    }
}

/* Whether a wall shows its outside. */
static bool face_wall(const Scan *scan, const double *start, const double *end, Wall *wall, bool *is_front) {
    wall->x = start[0], wall->y = start[1];
    wall->along_x = end[0] - start[0], wall->along_y = end[1] - start[1];
    wall->area = wall->x * wall->along_y - wall->y * wall->along_x;
    *is_front = wall->area < 0.0;
    if (!*is_front) return true;
    /* Seen from outside, a wall runs clockwise: its end comes first. */
    double low = portable_atan2(wall->y + wall->along_y, wall->x + wall->along_x);
    double width = portable_atan2(wall->y, wall->x) - low; /* in [-2 pi, 2 pi] */
    width = width < 0.0 ? width + TAU : width >= TAU ? 0.0 : width;
    return find_columns(scan->rays, low, low + width, &wall->columns);
}

static bool cast_on_walls(const Scan *scan, PyObject *object) {
    Array start, end, owner, *arrays[] = {&start, &end, &owner};
    if (!open_fields(object, &WALLS, "ddl", arrays)) return false;
    PyObject *top = get_field(object, &WALLS, 3);
    Wall *walls = malloc((owner.count + 1) * sizeof *walls);
    double top_m;
    Py_ssize_t fronts = 0;
    bool is_valid = top && read_number(top, &top_m);
    if (is_valid && !walls) PyErr_NoMemory(), is_valid = false;
    if (is_valid && (start.count != 2 * owner.count || end.count != 2 * owner.count))
        is_valid = refuse("expected a start and an end (E, 2) of each wall");
    for (Py_ssize_t i = 0; is_valid && i < owner.count; i++) {
        bool is_front;
        Wall *wall = walls + fronts;
        is_valid = face_wall(scan, doubles(&start) + 2 * i, doubles(&end) + 2 * i, wall, &is_front);
        wall->top = top_m, wall->owner = ((const int64_t *)owner.data)[i];
        fronts += is_valid && is_front;
    }
    for (int pass = 0; is_valid && pass < 2; pass++)
        for (Py_ssize_t i = 0; i < fronts; i++) intersect_wall(scan, walls + i, !pass);
    free(walls);
    if (top) Py_DecRef(top);
    close_arrays(3, arrays);
    return is_valid;
}

typedef struct {
    double x, y, length, width, top;
    CosSin yaw;
    double own_x, own_y; /* the sensor in the frame of the box */
    int64_t owner;
} LidarBox;

/* As _spans, of one box: the first and the last direction in which it is seen. */
static void find_span(const LidarBox *box, double *low, double *high) {
    *low = -PI, *high = PI;
    if (fabs(box->own_x) <= box->length / 2 && fabs(box->own_y) <= box->width / 2) return;
    double middle = portable_atan2(box->y, box->x), least = INFINITY, most = -INFINITY;
    for (int i = 0; i < 4; i++) {
        double ahead = CORNERS[0][i] * box->length / 2, left = CORNERS[1][i] * box->width / 2;
        double corner = portable_atan2(box->y + ahead * box->yaw.sin + left * box->yaw.cos,
                                       box->x + ahead * box->yaw.cos - left * box->yaw.sin);
        double aside = wrap_half_open(corner - middle);
        if (isnan(aside)) least = most = NAN;
        if (aside < least) least = aside;
        if (aside > most) most = aside;
    }
    *low = middle + least, *high = middle + most;
}

/* As _slab, of one box and ray. */
static void cut_slab(double start, double step, double half, double *in, double *out) {
    double inverse = 1 / (fabs(step) < 1e-300 ? 1e-300 : step);
    double middle = -start * inverse, reach = half * fabs(inverse);
    *in = middle - reach, *out = middle + reach;
}

static void intersect_column(const Scan *scan, const LidarBox *box, Py_ssize_t column) {
    const double *across = doubles(&scan->rays->across) + 2 * column;
    double step_x = across[0] * box->yaw.cos + across[1] * box->yaw.sin;
    double step_y = across[1] * box->yaw.cos - across[0] * box->yaw.sin;
    double in_x, out_x, in_y, out_y;
    cut_slab(box->own_x, step_x, box->length / 2, &in_x, &out_x);
    cut_slab(box->own_y, step_y, box->width / 2, &in_y, &out_y);
    double near = in_x > in_y || isnan(in_x) ? in_x : in_y, far = out_x < out_y || isnan(out_x) ? out_x : out_y;
    if (!(near <= far && far > 0.0 && (near > 0.0 || box->top < 0.0))) return;
    hit(scan, (Intersection){column, near > 0.0 ? near : 0.0, far, box->top, box->owner});
}

static bool intersect_box(const Scan *scan, LidarBox *box) {
    box->own_x = -box->x * box->yaw.cos - box->y * box->yaw.sin;
    box->own_y = box->x * box->yaw.sin - box->y * box->yaw.cos;
    double low, high;
    Columns columns;
    find_span(box, &low, &high);
    if (isnan(low) || isnan(box->yaw.cos)) return refuse("expected finite places of boxes and walls");
    if (!find_columns(scan->rays, low, high, &columns)) return false;
    for (Py_ssize_t i = 0, column = columns.first; i < columns.count; i++, column++) {
        if (column == scan->rays->columns) column = 0;
        intersect_column(scan, box, column);
    }
    return true;
}

static bool cast_on_boxes(const Scan *scan, PyObject *object) {
    Array columns[7], *arrays[7];
    for (int i = 0; i < 7; i++) arrays[i] = columns + i;
    if (!open_fields(object, &BOXES, "ddddddl", arrays)) return false;
    bool is_valid = true;
    for (int i = 1; i < 7; i++) is_valid = is_valid && columns[i].count == columns->count;
    if (!is_valid) refuse("expected columns of boxes with as many rows");
    for (Py_ssize_t i = 0; is_valid && i < columns->count; i++) {
        LidarBox box = {.x = doubles(columns)[i],
                        .y = doubles(columns + 1)[i],
                        .yaw = cos_sin(doubles(columns + 2)[i]),
                        .length = doubles(columns + 3)[i],
                        .width = doubles(columns + 4)[i],
                        .top = doubles(columns + 5)[i],
                        .owner = ((const int64_t *)columns[6].data)[i]};
        is_valid = intersect_box(scan, &box);
    }
    close_arrays(7, arrays);
    return is_valid;
}

static bool cast_rays(const Rays *rays, PyObject *const *arguments, double height, int64_t *best) {
    Scan scan = {rays, height, malloc((rays->columns + 1) * sizeof *scan.nearest), best};
    if (!scan.nearest) return PyErr_NoMemory(), false;
    for (Py_ssize_t i = 0; i < rays->columns; i++) scan.nearest[i] = INFINITY;
    bool is_valid = cast_on_walls(&scan, arguments[2]) && cast_on_boxes(&scan, arguments[1]);
    free(scan.nearest);
    return is_valid;
}

static PyObject *sensing_lidar_cast_cast_rays(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    Rays rays;
    Array ground;
    double height;
    if (!expect_arguments("cast_rays", count, 5, 5) || !read_number(arguments[3], &height) ||
        !open_rays(arguments[0], &rays))
        return NULL;
    PyObject *result = NULL;
    if (open_array(arguments[4], 'l', &ground)) {
        int64_t *best;
        if (ground.count != rays.order.count || ground.dimensions != 1) refuse("expected a key for each ray");
        else result = new_array('l', 1, ground.shape, (void **)&best);
        if (result) memcpy(best, ground.data, ground.count * sizeof *best);
        if (result && !cast_rays(&rays, arguments, height, best)) {
            Py_DecRef(result);
            result = NULL;
        }
        close_array(&ground);
    }
    close_rays(&rays);
    return result;
}

Functions sensing_lidar_cast = {
    FUNCTION(sensing_lidar_cast_cast_rays),
    END_OF_FUNCTIONS,
};
