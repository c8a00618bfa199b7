/* Twins of measurements.py. */
#include "measurements.h"

#include <stdlib.h>

#include "../core/portable.h"
#include "../core/state.h"
#include "tracking_parameters.h"

static const double DT = 1.0 / 20;
static Import MEASUREMENT = {"mdrive_sumo.perception.measurements", "MEASUREMENT", 0};
static Import MEASUREMENTS = {"mdrive_sumo.perception.measurements", "Measurements", 0};
static Import STATIONS = {"mdrive_sumo.perception.measurements", "STATIONS", 0};
static Import OWN_SENSOR = {"mdrive_sumo.perception.measurements", "OWN_SENSOR", 0};
FIELDS(MEASUREMENTS_FIELDS, "sources", "names", "rows");

FIELDS(TRACKING, "acceleration_sigma", "turn_acceleration_sigma", "max_turn_rate", "gate", "known_name_gate",
       "known_name_bonus", "min_gate_widths", "correlation_ticks", "confirmation_ticks", "moving_speed", "lead_m",
       "lead_lateral_m", "lead_yaw", "coasting_ticks", "standing_coasting_ticks", "tentative_ticks", "standstill_ticks",
       "standstill_count", "standstill_sigmas", "standstill_m", "standstill_speed_sigmas", "standstill_speeds",
       "own_radius_m", "never_ticks", "position_floor", "yaw_floor", "speed_floor", "size_weight");

bool read_tracking_parameters(PyObject *object, TrackingParameters *parameters) {
    return read_fields(object, &TRACKING, (double *)parameters);
}

static bool is_tuple_of(PyObject *object, Py_ssize_t least) {
    return object && PyType_IsSubtype(object->ob_type, &PyTuple_Type) && PyTuple_Size(object) >= least;
}

bool open_measurements(PyObject *object, OpenMeasurements *open) {
    open->sources = get_field(object, &MEASUREMENTS_FIELDS, 0);
    open->names = open->sources ? get_field(object, &MEASUREMENTS_FIELDS, 1) : NULL;
    PyObject *rows = open->names ? get_field(object, &MEASUREMENTS_FIELDS, 2) : NULL;
    bool is_open = rows && open_rows(rows, sizeof(Measurement), &open->rows);
    if (rows) Py_DecRef(rows);
    if (is_open) {
        open->row = open->rows.data;
        open->count = open->rows.count;
        if (is_tuple_of(open->sources, 1) && is_tuple_of(open->names, open->count)) {
            open->is_own = PyObject_Size(PyTuple_GetItem(open->sources, 0)) == 0;
            return true;
        }
        close_array(&open->rows);
        PyErr_SetString(PyExc_ValueError, "expected measurements with sources and a name for each row");
    }
    if (open->sources) Py_DecRef(open->sources);
    if (open->names) Py_DecRef(open->names);
    return false;
}

void close_measurements(OpenMeasurements *open) {
    close_array(&open->rows);
    Py_DecRef(open->sources);
    Py_DecRef(open->names);
}

/* An uncertain pose: OwnState, or ReferencePose with its tick. */
typedef struct {
    double x, y, position_sigma, yaw_sigma;
} UncertainPose;
FIELDS(UNCERTAIN_POSE, "x", "y", "position_sigma", "yaw_sigma");

/* What a source says of one object, and how uncertain that is. */
typedef struct {
    int64_t kind;
    double x, y, yaw, speed, length, width, position_sigma, yaw_sigma, speed_sigma, bias, age_s, turn, repetitions;
} Report;

static Report read_object(const RoadUsers *objects, Py_ssize_t i) {
    return (Report){.kind = kinds_of(objects)[i],
                    .x = x_of(objects)[i],
                    .y = y_of(objects)[i],
                    .yaw = yaws_of(objects)[i],
                    .speed = speeds_of(objects)[i],
                    .length = lengths_of(objects)[i],
                    .width = widths_of(objects)[i],
                    .repetitions = 1.0};
}

static double square(double x) { return x * x; }

static double count_repetitions(double elapsed_ticks, const TrackingParameters *parameters) {
    double repetitions = parameters->correlation_ticks / (elapsed_ticks > 1.0 ? elapsed_ticks : 1.0);
    return repetitions > 1.0 ? repetitions : 1.0;
}

static double compute_lever(const Report *report, const UncertainPose *pose) {
    double distance_2 = square(report->x - pose->x) + square(report->y - pose->y);
    return pose->position_sigma * pose->position_sigma + distance_2 * (pose->yaw_sigma * pose->yaw_sigma / 2);
}

/* False, with an error, for an angle that is not finite. */
static bool build_row(const Report *report, const TrackingParameters *parameters, Measurement *row) {
    double age_2 = square(report->age_s), half_turn = report->turn / 2;
    double position = (square(report->position_sigma) + square(parameters->position_floor)) * report->repetitions;
    double yaw_variance = (square(report->yaw_sigma) + square(parameters->yaw_floor)) * report->repetitions;
    double speed_variance = (square(report->speed_sigma) + square(parameters->speed_floor)) * report->repetitions;
    double chord = report->speed * report->age_s * portable_sinc(half_turn / PI);
    CosSin along = cos_sin(report->yaw + half_turn);
    double yaw = report->yaw + report->turn;
    CosSin heading = cos_sin(yaw);
    if (!isfinite(along.cos) || !isfinite(heading.cos)) {
        PyErr_SetString(PyExc_ValueError, "expected objects with finite angles, found NaN or infinity");
        return false;
    }
    *row = (Measurement){
        .kind = report->kind,
        .x = report->x + chord * along.cos,
        .y = report->y + chord * along.sin,
        .vx = report->speed * heading.cos,
        .vy = report->speed * heading.sin,
        .yaw = yaw,
        .length = report->length,
        .width = report->width,
        .position = position + age_2 * speed_variance + square(parameters->acceleration_sigma * age_2 / 2),
        .bias = report->bias,
        .yaw_variance = yaw_variance,
        .speed_variance = speed_variance + square(parameters->acceleration_sigma * report->age_s),
    };
    return true;
}

/* Takes the sources, and the names. */
static PyObject *build_measurements(PyObject *sources, PyObject *names, const Measurement *rows, Py_ssize_t count) {
    void *data;
    PyObject *array = new_rows(&MEASUREMENT, count, sizeof *rows, &data);
    for (Py_ssize_t i = 0; array && i < count; i++) ((Measurement *)data)[i] = rows[i];
    return build_instance(&MEASUREMENTS, &MEASUREMENTS_FIELDS, (PyObject *[]){sources, names, array});
}

FIELDS(PROFILE, "spread", "spread_doubles_m", "yaw_sigma", "speed_sigma", "latency_ticks");

static PyObject *perception_measurements_measure_detections(PyObject *module, PyObject *const *arguments,
                                                            Py_ssize_t count) {
    struct {
        double spread, spread_doubles_m, yaw_sigma, speed_sigma, latency_ticks;
    } profile;
    UncertainPose own;
    double elapsed_ticks;
    TrackingParameters parameters;
    RoadUsers seen;
    if (!expect_arguments("measure_detections", count, 5, 5) || !read_fields(arguments[1], &UNCERTAIN_POSE, &own.x) ||
        !read_fields(arguments[2], &PROFILE, &profile.spread) || !read_number(arguments[3], &elapsed_ticks) ||
        !read_tracking_parameters(arguments[4], &parameters) || !open_road_users(arguments[0], &seen))
        return NULL;
    void *data;
    PyObject *source = find_import(&OWN_SENSOR);
    PyObject *rows = source ? new_rows(&MEASUREMENT, seen.count, sizeof(Measurement), &data) : NULL;
    for (Py_ssize_t i = 0; rows && i < seen.count; i++) {
        Report report = read_object(&seen, i);
        double distance = portable_hypot(report.x - own.x, report.y - own.y);
        report.position_sigma = profile.spread * (1.0 + distance / profile.spread_doubles_m);
        report.yaw_sigma = profile.yaw_sigma, report.speed_sigma = profile.speed_sigma;
        report.repetitions = count_repetitions(elapsed_ticks, &parameters);
        report.age_s = profile.latency_ticks * DT;
        if (!build_row(&report, &parameters, (Measurement *)data + i)) {
            Py_DecRef(rows);
            rows = NULL;
        }
    }
    PyObject *sources = rows ? pack(1, new_reference(source)) : NULL;
    PyObject *result = build_instance(&MEASUREMENTS, &MEASUREMENTS_FIELDS,
                                      (PyObject *[]){sources, new_reference(seen.ids), rows});
    close_road_users(&seen);
    return result;
}

/* Rows so far, and the names of each. */
typedef struct {
    Measurement *rows;
    PyObject *names; /* a list */
    Py_ssize_t count, room;
} Collection;

/* Adds an object unless it is the own car or has no size. */
static bool collect(Collection *all, const Report *report, Py_ssize_t source, PyObject *name, const UncertainPose *own,
                    const TrackingParameters *parameters) {
    if (all->count == all->room) {
        Py_ssize_t room = 2 * all->room + 16;
        Measurement *rows = realloc(all->rows, (size_t)room * sizeof *rows);
        if (!rows) return PyErr_NoMemory(), false;
        all->rows = rows, all->room = room;
    }
    Measurement *row = all->rows + all->count;
    if (!build_row(report, parameters, row)) return false;
    row->source = source;
    bool is_far = square(row->x - own->x) + square(row->y - own->y) > parameters->own_radius_m * parameters->own_radius_m;
    if (!(is_far && row->length > 0.0 && row->width > 0.0)) return true;
    all->count++;
    return !PyList_Append(all->names, name);
}

/* Takes the sources; frees the collection. */
static PyObject *finish(Collection *all, PyObject *sources, bool is_complete) {
    PyObject *names = is_complete && sources ? PyTuple_New(all->count) : NULL;
    for (Py_ssize_t i = 0; names && i < all->count; i++)
        PyTuple_SetItem(names, i, new_reference(PyList_GetItem(all->names, i)));
    PyObject *result = NULL;
    if (names) result = build_measurements(sources, names, all->rows, all->count);
    else if (sources) Py_DecRef(sources);
    free(all->rows);
    if (all->names) Py_DecRef(all->names);
    return result;
}

FIELDS(POSE, "pose");
FIELDS(POSE_NUMBERS, "x", "y", "position_sigma", "yaw_sigma", "yaw", "tick");
typedef struct {
    UncertainPose place;
    double yaw, tick;
} Pose;

static bool read_pose(PyObject *message, Pose *pose) {
    PyObject *object = get_field(message, &POSE, 0);
    bool is_read = object && read_fields(object, &POSE_NUMBERS, &pose->place.x);
    if (object) Py_DecRef(object);
    return is_read;
}

/* Entry `i` of a list of tuples, which is borrowed, or NULL with an error. */
static PyObject *get_entry(PyObject *list, Py_ssize_t i, Py_ssize_t length) {
    PyObject *entry = PyList_GetItem(list, i);
    if (entry && is_tuple_of(entry, length)) return entry;
    if (entry) PyErr_SetString(PyExc_TypeError, "expected a list of tuples, found another object in it");
    return NULL;
}

typedef struct {
    double tick;
    UncertainPose own;
    TrackingParameters parameters;
} Present;

static bool read_present(PyObject *const *arguments, Present *present) {
    return read_number(arguments[0], &present->tick) && read_fields(arguments[2], &UNCERTAIN_POSE, &present->own.x) &&
           read_tracking_parameters(arguments[3], &present->parameters);
}

FIELDS(CAM_NUMBERS, "speed", "yaw_rate", "length", "width", "speed_sigma");

static bool collect_station(Collection *all, PyObject *entry, const Present *present) {
    struct {
        double speed, yaw_rate, length, width, speed_sigma;
    } cam;
    Pose pose;
    PyObject *message = PyTuple_GetItem(entry, 1);
    if (!read_pose(message, &pose) || !read_fields(message, &CAM_NUMBERS, &cam.speed)) return false;
    double age_s = (present->tick - pose.tick) * DT;
    Report report = {.x = pose.place.x,
                     .y = pose.place.y,
                     .yaw = pose.yaw,
                     .speed = cam.speed,
                     .length = cam.length,
                     .width = cam.width,
                     .yaw_sigma = pose.place.yaw_sigma,
                     .speed_sigma = cam.speed_sigma,
                     .age_s = age_s,
                     .turn = cam.yaw_rate * age_s,
                     .repetitions = 1.0};
    report.bias = square(pose.place.position_sigma) + compute_lever(&report, &present->own);
    return collect(all, &report, 0, PyTuple_GetItem(entry, 0), &present->own, &present->parameters);
}

static PyObject *perception_measurements_measure_stations(PyObject *module, PyObject *const *arguments,
                                                          Py_ssize_t count) {
    Present present;
    if (!expect_arguments("measure_stations", count, 4, 4) || !read_present(arguments, &present)) return NULL;
    Py_ssize_t stations = PyList_Size(arguments[1]);
    if (stations < 0) return NULL;
    Collection all = {.names = PyList_New(0)};
    bool is_complete = all.names;
    for (Py_ssize_t i = 0; is_complete && i < stations; i++) {
        PyObject *entry = get_entry(arguments[1], i, 2);
        is_complete = entry && collect_station(&all, entry, &present);
    }
    PyObject *source = is_complete ? find_import(&STATIONS) : NULL;
    return finish(&all, source ? pack(1, new_reference(source)) : NULL, is_complete);
}

FIELDS(CPM_PARTS, "objects", "age", "sigmas");

static bool collect_objects(Collection *all, Py_ssize_t source, PyObject *message, double elapsed_ticks,
                            const RoadUsers *objects, const unsigned char *age, const Array *sigmas,
                            const Present *present) {
    Pose pose;
    if (!read_pose(message, &pose)) return false;
    for (Py_ssize_t i = 0; i < objects->count; i++) {
        Report report = read_object(objects, i);
        if (sigmas->count) {
            const double *sigma = doubles(sigmas) + 3 * i;
            report.position_sigma = sigma[0], report.yaw_sigma = sigma[1], report.speed_sigma = sigma[2];
        }
        report.repetitions = count_repetitions(elapsed_ticks, &present->parameters);
        report.age_s = (present->tick - pose.tick + age[i]) * DT;
        report.bias = compute_lever(&report, &pose.place) + compute_lever(&report, &present->own);
        PyObject *name = PyTuple_GetItem(objects->ids, i);
        if (!collect(all, &report, source, name, &present->own, &present->parameters)) return false;
    }
    return true;
}

static bool collect_report(Collection *all, Py_ssize_t source, PyObject *entry, const Present *present) {
    double elapsed_ticks;
    PyObject *message = PyTuple_GetItem(entry, 1);
    if (!read_number(PyTuple_GetItem(entry, 2), &elapsed_ticks)) return false;
    PyObject *parts[3] = {0};
    for (int i = 0; i < 3 && (!i || parts[i - 1]); i++) parts[i] = get_field(message, &CPM_PARTS, i);
    RoadUsers objects;
    Array age, sigmas;
    bool is_complete = false;
    if (parts[2] && open_road_users(parts[0], &objects)) {
        if (open_array(parts[1], 'B', &age)) {
            if (open_doubles(parts[2], 2, &sigmas)) {
                if (age.count == objects.count && (!sigmas.count || sigmas.count == 3 * objects.count))
                    is_complete = collect_objects(all, source, message, elapsed_ticks, &objects, age.data, &sigmas, present);
                else PyErr_SetString(PyExc_ValueError, "expected an age and three sigmas for each object of a CPM");
                close_array(&sigmas);
            }
            close_array(&age);
        }
        close_road_users(&objects);
    }
    for (int i = 0; i < 3; i++)
        if (parts[i]) Py_DecRef(parts[i]);
    return is_complete;
}

static PyObject *perception_measurements_measure_reported(PyObject *module, PyObject *const *arguments,
                                                          Py_ssize_t count) {
    Present present;
    if (!expect_arguments("measure_reported", count, 4, 4) || !read_present(arguments, &present)) return NULL;
    Py_ssize_t reports = PyList_Size(arguments[1]);
    PyObject *sources = reports < 0 ? NULL : PyTuple_New(reports);
    if (!sources) return NULL;
    Collection all = {.names = PyList_New(0)};
    bool is_complete = all.names;
    for (Py_ssize_t i = 0; is_complete && i < reports; i++) {
        PyObject *entry = get_entry(arguments[1], i, 3);
        is_complete = entry && !PyTuple_SetItem(sources, i, new_reference(PyTuple_GetItem(entry, 0))) &&
                      collect_report(&all, i, entry, &present);
    }
    return finish(&all, sources, is_complete);
}

Functions perception_measurements = {
    FUNCTION(perception_measurements_measure_detections),
    FUNCTION(perception_measurements_measure_stations),
    FUNCTION(perception_measurements_measure_reported),
    END_OF_FUNCTIONS,
};
