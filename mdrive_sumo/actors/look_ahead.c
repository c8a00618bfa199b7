/* The functions of look_ahead.py and path_tables.sample_ahead, for one actor and one obstacle after the other. */
#include "look_ahead.h"

typedef struct {
    double x, y, yaw;
} PathPoint;

static PathPoint sample_ahead(const Looker *looker, double s) {
    const Mover *mover = looker->mover;
    s = minimum(s, mover->path_length);
    double key = (double)looker->row * ROW_STRIDE + s;
    int64_t after = mover->first, end = mover->last + 1;
    while (after < end) { /* the first knot whose key is not less */
        int64_t middle = after + (end - after) / 2;
        if (looker->knots[middle].length_key < key) after = middle + 1;
        else end = middle;
    }
    if (after < mover->first + 1) after = mover->first + 1;
    if (after > mover->last || key != key) after = mover->last;
    const Knot *high = looker->knots + after, *low = high - 1;
    double step = high->s - low->s, share = step > 0.0 ? (s - low->s) / step : 0.0;
    double dx = high->x - low->x, dy = high->y - low->y;
    double yaw = step > 1e-6 ? portable_atan2(dy, dx) : low->yaw;
    return (PathPoint){low->x + share * dx, low->y + share * dy, yaw};
}

Looker start_looking(const MoversOnPaths *open, Py_ssize_t row) {
    const Mover *mover = open->mover + row;
    double stopping_m = mover->speed * mover->speed / (2.0 * mover->comfort_brake);
    return (Looker){.mover = mover,
                    .knots = open->knot,
                    .row = row,
                    .half_width = mover->half_width + mover->clearance,
                    .reach = stopping_m + mover->gap + mover->look_margin};
}

/* As numpy.linspace(0, 1, SAMPLES). */
static double spread_sample(const Looker *looker, int i) {
    return looker->reach * (i < SAMPLES - 1 ? i * (1.0 / (SAMPLES - 1)) : 1.0);
}

static bool sample_path(Looker *looker) {
    for (int i = 0; i < SAMPLES && !looker->is_sampled; i++) {
        PathPoint point = sample_ahead(looker, looker->mover->s + spread_sample(looker, i));
        looker->x[i] = point.x, looker->y[i] = point.y;
        looker->direction[i] = cos_sin(point.yaw);
        if (!isfinite(looker->direction[i].cos)) {
            PyErr_SetString(PyExc_ValueError, "expected paths with finite directions, found NaN or infinity");
            return false;
        }
    }
    looker->is_sampled = true;
    return true;
}

/* Of a looker and an obstacle: the free path between the boxes, and the other's speed along it. */
typedef struct {
    double clearance, along;
} Clearance;

static Clearance compute_clearance(const Looker *looker, const Surrounding *other, double extension_m) {
    const Mover *mover = looker->mover;
    double cos_o = other->heading.cos, sin_o = other->heading.sin, half = extension_m / 2;
    double other_x = other->x + cos_o * half, other_y = other->y + sin_o * half;
    double length = other->half_length + half, width = other->half_width, half_width = looker->half_width;
    double swept = maximum(mover->half_length, looker->reach / (SAMPLES - 1) / 2), nearest = NAN;
    int row = 0;
    for (int i = 0; i < SAMPLES; i++) {
        double x = other_x - looker->x[i], y = other_y - looker->y[i];
        double cos = looker->direction[i].cos, sin = looker->direction[i].sin;
        double turned = fabs(cos * cos_o + sin * sin_o), crossed = fabs(cos * sin_o - sin * cos_o);
        double along = x * cos + y * sin, extent = turned * length + crossed * width;
        /* Separating axes: along and across the path, along and across the other box. */
        bool is_hit = fabs(along) < swept + extent &&
                      fabs(y * cos - x * sin) < half_width + crossed * length + turned * width &&
                      fabs(x * cos_o + y * sin_o) < length + turned * swept + crossed * half_width &&
                      fabs(y * cos_o - x * sin_o) < width + crossed * swept + turned * half_width;
        double centre = spread_sample(looker, i) + along;
        double clearance = is_hit && centre > 0.0 ? centre - mover->half_length - extent : INFINITY;
        if (!i || clearance < nearest || (isnan(clearance) && !isnan(nearest))) nearest = clearance, row = i;
    }
    double heading = looker->direction[row].cos * cos_o + looker->direction[row].sin * sin_o;
    return (Clearance){nearest, heading * other->speed};
}

static double compute_allowed_speed(double clearance, double speed, const Mover *mover) {
    double slack = clearance - mover->gap;
    if (slack > 0.0) return compute_safe_speed(slack, speed, mover->comfort_brake);
    return speed * clip(clearance / mover->gap, 0.0, 1.0);
}

static bool find_overlap(const Looker *looker, const Surrounding *other) {
    const Mover *mover = looker->mover;
    PathPoint here = sample_ahead(looker, mover->s);
    Box own = box_corners(here.x, here.y, here.yaw, 2 * mover->half_length, 2 * looker->half_width);
    Box box = list_corners(other->x, other->y, other->heading.cos, other->heading.sin, 2 * other->half_length,
                           2 * other->half_width);
    return boxes_overlap(&own, &box);
}

bool limit_speed(Looker *looker, const Surrounding *other, Py_ssize_t number, FreeSpeed *free) {
    const Mover *mover = looker->mover;
    /* It gives way to pedestrians and to actors before it: their boxes cover the positions of the next seconds. */
    bool yields = mover->prediction_s > 0.0 && other->index >= 0 && (other->is_pedestrian || other->index < looker->row);
    double extension_m = yields ? mover->prediction_s * other->speed : 0.0;
    double far = looker->reach + mover->half_length + looker->half_width;
    far = far + (other->half_length + other->half_width) + extension_m;
    double x = mover->x - other->x, y = mover->y - other->y;
    if (!(x * x + y * y < far * far)) return true;
    if (!isfinite(other->heading.cos)) {
        PyErr_SetString(PyExc_ValueError, "expected finite headings of road users, found NaN or infinity");
        return false;
    }
    bool is_first = !looker->is_sampled;
    if (!sample_path(looker)) return false;
    Clearance free_path = compute_clearance(looker, other, extension_m);
    double allowed = compute_allowed_speed(free_path.clearance, maximum(free_path.along, 0.0), mover);
    if (free_path.clearance < 0.0 && !other->is_cav && find_overlap(looker, other)) allowed = INFINITY;
    if (is_first || allowed < free->speed || (isnan(free->speed) && !isnan(allowed)))
        *free = (FreeSpeed){allowed, isfinite(allowed) ? number : -1};
    return true;
}
