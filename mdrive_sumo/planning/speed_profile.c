/* Twins of speed_profile.py. */
#include "path_overlap.h"

FIELDS(PROFILE, "s", "speed", "step_s");
FIELDS(LATTICE, "cell_m", "speed_step");

typedef struct {
    Array s, speed;
    double step_s;
} Profile;

static bool open_profile(PyObject *profile, Profile *opened) {
    if (!read_number_field(profile, &PROFILE, 2, &opened->step_s) ||
        !open_field(profile, &PROFILE, 0, 'd', 1, &opened->s))
        return false;
    if (!open_field(profile, &PROFILE, 1, 'd', 1, &opened->speed)) {
        close_array(&opened->s);
        return false;
    }
    if (opened->s.count && opened->speed.count == opened->s.count) return true;
    PyErr_SetString(PyExc_ValueError, "expected a speed at each of some stations");
    close_arrays(2, (Array *[]){&opened->s, &opened->speed});
    return false;
}

static void close_profile(Profile *profile) { close_arrays(2, (Array *[]){&profile->s, &profile->speed}); }

static double compute_station(const Profile *profile, double t) {
    const double *s = doubles(&profile->s), *speed = doubles(&profile->speed), step_s = profile->step_s;
    Py_ssize_t count = profile->s.count;
    double index = t / step_s;
    Py_ssize_t k = index > 0.0 ? index < (double)(count - 1) ? (Py_ssize_t)index : count - 1 : 0;
    double rest = t - (double)k * step_s, acceleration = (k + 1 < count ? speed[k + 1] - speed[k] : 0.0) / step_s;
    return s[k] + speed[k] * rest + acceleration * (rest * rest) / 2;
}

static PyObject *planning_speed_profile_compute_stations(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    double *stations;
    Array t;
    Profile profile;
    if (!expect_arguments("compute_stations", count, 2, 2) || !open_doubles(arguments[1], 1, &t)) return NULL;
    if (!open_profile(arguments[0], &profile)) {
        close_array(&t);
        return NULL;
    }
    PyObject *result = new_doubles(1, &t.count, &stations);
    for (Py_ssize_t i = 0; result && i < t.count; i++) stations[i] = compute_station(&profile, doubles(&t)[i]);
    close_profile(&profile);
    close_array(&t);
    return result;
}

static PyObject *planning_speed_profile_compute_station(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    double t;
    Profile profile;
    if (!expect_arguments("compute_station", count, 2, 2) || !read_number(arguments[1], &t) ||
        !open_profile(arguments[0], &profile))
        return NULL;
    double station = compute_station(&profile, t);
    close_profile(&profile);
    return PyFloat_FromDouble(station);
}

/* A point of the path at each cell, and the highest speed there in steps of the lattice. */
static bool fill_cells(const Array *speeds, const double *lattice, double lattice_s, Py_ssize_t count, int64_t *cells,
                       int64_t *limits) {
    double first = round_even(lattice_s / SPACING_M), share = lattice[0] / SPACING_M, last = (double)(speeds->count - 1);
    for (Py_ssize_t i = 0; i < count; i++) {
        double cell = first + round_even((double)i * share);
        if (cell > last) cell = last;
        if (!(cell >= -last - 1.0)) {
            PyErr_SetString(PyExc_ValueError, "expected cells on the path");
            return false;
        }
        cells[i] = (int64_t)cell;
        double steps = floor(doubles(speeds)[cell < 0.0 ? cells[i] + speeds->count : cells[i]] / lattice[1] + 1e-6);
        limits[i] = steps > 1.0 ? steps < 1e15 ? (int64_t)steps : 1000000000000000 : 1;
    }
    return true;
}

static PyObject *planning_speed_profile_list_cells(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    double lattice[2], lattice_s;
    Py_ssize_t length;
    Array speeds;
    if (!expect_arguments("list_cells", count, 4, 4) || !read_fields(arguments[1], &LATTICE, lattice) ||
        !read_number(arguments[2], &lattice_s) || !read_integer(arguments[3], &length) ||
        !open_doubles(arguments[0], 1, &speeds))
        return NULL;
    if (length < 0) length = 0;
    void *cells = NULL, *limits = NULL;
    PyObject *first = new_array('l', 1, &length, &cells), *second = new_array('l', 1, &length, &limits);
    bool are_filled = first && second && fill_cells(&speeds, lattice, lattice_s, length, cells, limits);
    close_array(&speeds);
    if (are_filled) return pack(2, first, second);
    if (first) Py_DecRef(first);
    if (second) Py_DecRef(second);
    return NULL;
}

Functions planning_speed_profile = {
    FUNCTION(planning_speed_profile_compute_stations),
    FUNCTION(planning_speed_profile_compute_station),
    FUNCTION(planning_speed_profile_list_cells),
    END_OF_FUNCTIONS,
};
