/* What motion_prediction.h has for other C files; its Python text has no compiled functions of its own. */
#include "motion_prediction.h"

FIELDS(PARAMETERS, "reliable_s", "acceleration", "top_speed", "walking_top_speed", "hesitation_braking", "hesitation_s",
       "reaction_s", "yielding_braking", "standing_speed", "max_turn_rad");
static Import MOTION = {"mdrive_sumo.planning.parameters", "MOTION", 0};

bool read_motion_parameters(MotionParameters *parameters) {
    PyObject *motion = find_import(&MOTION);
    _Static_assert(sizeof *parameters == 10 * sizeof(double), "a number for each field");
    return motion && read_fields(motion, &PARAMETERS, (double *)parameters);
}

bool place_on_arc(const double *pose, double travelled, double curvature, double max_turn_rad, double *placed) {
    double turned = clip(curvature * travelled, -max_turn_rad, max_turn_rad), angle = PI * (turned / 2 / PI);
    double sinc = angle != 0.0 ? cos_sin(angle).sin / angle : 1.0, chord = travelled * sinc;
    CosSin direction = cos_sin(pose[2] + turned / 2);
    placed[0] = pose[0] + chord * direction.cos, placed[1] = pose[1] + chord * direction.sin;
    placed[2] = pose[2] + turned;
    if (isfinite(direction.cos) && isfinite(sinc)) return true;
    PyErr_SetString(PyExc_ValueError, "expected finite headings and turns, found NaN or infinity");
    return false;
}

double interpolate_cells(const double *values, Py_ssize_t step, Py_ssize_t count, double index) {
    if (index != index) return index;
    if (index < 0.0) return values[0];
    if (index >= (double)(count - 1)) return values[(count - 1) * step];
    Py_ssize_t low = (Py_ssize_t)index;
    double before = values[low * step];
    return index == (double)low ? before : (values[(low + 1) * step] - before) * (index - (double)low) + before;
}

double interpolate_yaw(const Path *path, double s) {
    const double *yaw = doubles(&path->yaw);
    double index = s / SPACING_M;
    if (!(index >= 0.0 && index < (double)(path->count - 1))) return interpolate_cells(yaw, 1, path->count, index);
    Py_ssize_t low = (Py_ssize_t)index;
    double ahead_m = s - (double)low * SPACING_M;
    return ahead_m == 0.0 ? yaw[low] : (yaw[low + 1] - yaw[low]) / SPACING_M * ahead_m + yaw[low];
}

void place_on_path(const Path *path, double s, double *placed) {
    const double *xy = doubles(&path->xy);
    placed[0] = interpolate_cells(xy, 2, path->count, s / SPACING_M);
    placed[1] = interpolate_cells(xy + 1, 2, path->count, s / SPACING_M);
    placed[2] = interpolate_yaw(path, s);
}

bool project_on_path(const Path *path, double x, double y, double near_s, double within_m, double *s) {
    double first = (near_s - within_m) / SPACING_M, last = (near_s + within_m) / SPACING_M;
    if (!(fabs(first) < 1e15 && fabs(last) < 1e15)) {
        PyErr_SetString(PyExc_ValueError, "expected finite stations, found NaN or infinity");
        return false;
    }
    Py_ssize_t low = first > 0.0 ? (Py_ssize_t)first : 0, high = (Py_ssize_t)last + 2, nearest;
    if (high < 1) high = 1;
    if (high > path->count) high = path->count;
    if (low > high - 1) low = high - 1;
    const double *xy = doubles(&path->xy);
    double least_square = INFINITY;
    nearest = low;
    for (Py_ssize_t i = low; i < high; i++) {
        double dx = x - xy[2 * i], dy = y - xy[2 * i + 1], square = dx * dx + dy * dy;
        if (square < least_square) least_square = square, nearest = i;
    }
    CosSin direction = cos_sin(doubles(&path->yaw)[nearest]);
    double along = direction.cos * (x - xy[2 * nearest]) + direction.sin * (y - xy[2 * nearest + 1]);
    double station = (double)nearest * SPACING_M + along;
    if (station < 0.0) station = 0.0;
    *s = get_length(path) < station ? get_length(path) : station;
    return true;
}
