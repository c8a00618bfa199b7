/* Twins of track_list.py. */
#include <stdlib.h>
#include <string.h>

#include "../contract/sensors.h"
#include "../core/geometry.h"
#include "../core/state.h"
#include "assignment.h"
#include "measurements.h"
#include "track_states.h"
#include "tracking_parameters.h"

static double square(double x) { return x * x; }
static bool is_on_foot(int64_t kind) { return kind == PEDESTRIAN || kind == CYCLIST; }

/* The number of the track that this name had last, -1 for none. */
static bool find_number(PyObject *number_by_name, const OpenMeasurements *new, Py_ssize_t i, Py_ssize_t *number) {
    PyObject *source = PyTuple_GetItem(new->sources, (Py_ssize_t)new->row[i].source);
    if (!source) return false;
    PyObject *name = pack(2, new_reference(source), new_reference(PyTuple_GetItem(new->names, i)));
    PyObject *found = name ? PyDict_GetItemWithError(number_by_name, name) : NULL;
    if (name) Py_DecRef(name);
    *number = -1;
    return found ? read_integer(found, number) : name && !PyErr_Occurred();
}

static void compare_track(const Track *track, const OpenMeasurements *new, const Py_ssize_t *known,
                          const TrackingParameters *parameters, double *cost, unsigned char *possible) {
    for (Py_ssize_t i = 0; i < new->count; i++) {
        const Measurement *row = new->row + i;
        double distance_2 = square(track->x - row->x) + square(track->y - row->y);
        double distance = distance_2 / (track->position + (row->position + row->bias));
        bool is_known = known[i] == track->number;
        possible[i] = (distance <= (is_known ? parameters->known_name_gate : parameters->gate) ||
                       distance_2 <= square(parameters->min_gate_widths * row->width)) &&
                      is_on_foot(track->kind) == is_on_foot(row->kind);
        cost[i] = distance - parameters->known_name_bonus * is_known;
        if (!new->is_own) cost[i] -= parameters->known_name_bonus * (double)track->seen_by_sensor;
    }
}

/* Into cost and possible [tracks][measurements]. */
static bool compare_tracks(const Track *tracks, Py_ssize_t count, const OpenMeasurements *new, PyObject *number_by_name,
                           const TrackingParameters *parameters, double *cost, unsigned char *possible) {
    Py_ssize_t *known = malloc((size_t)(new->count + 1) * sizeof *known);
    if (!known) return PyErr_NoMemory(), false;
    bool is_read = true;
    for (Py_ssize_t i = 0; is_read && i < new->count; i++) is_read = find_number(number_by_name, new, i, known + i);
    for (Py_ssize_t i = 0; is_read && i < count; i++)
        compare_track(tracks + i, new, known, parameters, cost + i * new->count, possible + i * new->count);
    free(known);
    return is_read;
}

static PyObject *compare(const Array *tracks, const OpenMeasurements *new, PyObject *number_by_name,
                         const TrackingParameters *parameters) {
    Py_ssize_t shape[] = {tracks->count, new->count};
    double *cost = NULL;
    void *possible = NULL;
    PyObject *first = new_doubles(2, shape, &cost), *second = first ? new_array('?', 2, shape, &possible) : NULL;
    if (second && !compare_tracks(tracks->data, tracks->count, new, number_by_name, parameters, cost, possible)) {
        Py_DecRef(second);
        second = NULL;
    }
    return pack(2, first, second);
}

static PyObject *perception_track_list_compare(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    TrackingParameters parameters;
    Array tracks;
    OpenMeasurements new;
    if (!expect_arguments("compare", count, 4, 4) || !read_tracking_parameters(arguments[3], &parameters) ||
        !open_tracks(arguments[0], &tracks))
        return NULL;
    PyObject *result = NULL;
    if (open_measurements(arguments[1], &new)) {
        result = compare(&tracks, &new, arguments[2], &parameters);
        close_measurements(&new);
    }
    close_array(&tracks);
    return result;
}

FIELDS(TRACK_NAMES, "number_by_name", "station_by_number", "source_by_number");
static Import STATIONS = {"mdrive_sumo.perception.measurements", "STATIONS", 0};
enum { NUMBER_BY_NAME, STATION_BY_NUMBER, SOURCE_BY_NUMBER, DICTIONARIES };

typedef struct {
    PyObject *stations, *dictionary[DICTIONARIES]; /* borrowed from the instance of TrackOrigins */
} Names;

/* Tracks that change. */
typedef struct {
    Track *track;
    Py_ssize_t count;
} Tracks;

/* The station `name` is the track `number`, and not the track `before`, if it had one. */
static bool name_station(const Names *names, Tracks *tracks, PyObject *number, PyObject *name, PyObject *before,
                         const TrackingParameters *parameters) {
    PyObject *stations = names->dictionary[STATION_BY_NUMBER];
    Py_ssize_t old, new;
    if (PyDict_SetItem(stations, number, name)) return false;
    if (!before) return true;
    if (!read_integer(before, &old) || !read_integer(number, &new)) return false;
    if (old == new) return true;
    if (PyDict_GetItemWithError(stations, before) ? PyDict_DelItem(stations, before) : !!PyErr_Occurred()) return false;
    for (Py_ssize_t i = 0; i < tracks->count; i++)
        if (tracks->track[i].number == old) tracks->track[i].seen_tick = -(int64_t)parameters->never_ticks;
    return true;
}

static bool name_track(const Names *names, Tracks *tracks, PyObject *number, PyObject *source, PyObject *name,
                       const TrackingParameters *parameters) {
    PyObject *numbers = names->dictionary[NUMBER_BY_NAME];
    PyObject *key = pack(2, new_reference(source), new_reference(name));
    PyObject *before = key ? PyDict_GetItemWithError(numbers, key) : NULL;
    if (before) Py_IncRef(before); /* the dictionary lets go of it */
    bool is_named = key && !PyErr_Occurred() && !PyDict_SetItem(numbers, key, number);
    if (is_named && !PyUnicode_Compare(source, names->stations))
        is_named = name_station(names, tracks, number, name, before, parameters);
    if (before) Py_DecRef(before);
    if (key) Py_DecRef(key);
    return is_named;
}

static bool record_hit(const Names *names, Tracks *tracks, Py_ssize_t row, const OpenMeasurements *new,
                       Py_ssize_t column, const TrackingParameters *parameters) {
    Track *seen = tracks->track + row;
    PyObject *source = PyTuple_GetItem(new->sources, (Py_ssize_t)new->row[column].source);
    PyObject *number = source ? PyLong_FromLongLong(seen->number) : NULL;
    PyObject *birth = number ? PyDict_GetItemWithError(names->dictionary[SOURCE_BY_NUMBER], number) : NULL;
    if (birth) seen->confirmed |= PyUnicode_Compare(birth, source) != 0;
    else if (!PyErr_Occurred()) PyErr_SetString(PyExc_ValueError, "expected a source for each track");
    PyObject *name = PyTuple_GetItem(new->names, column);
    bool is_recorded = birth && name_track(names, tracks, number, source, name, parameters);
    if (number) Py_DecRef(number);
    return is_recorded && !PyErr_Occurred();
}

/* Dictionaries of the names that are borrowed: the instance keeps them. */
static bool read_names(PyObject *object, Names *names) {
    names->stations = find_import(&STATIONS);
    for (int i = 0; names->stations && i < DICTIONARIES; i++) {
        names->dictionary[i] = get_field(object, &TRACK_NAMES, i);
        if (!names->dictionary[i]) return false;
        Py_DecRef(names->dictionary[i]);
    }
    return names->stations;
}

static bool record_hits(Tracks *tracks, const int64_t *rows, const OpenMeasurements *new, const int64_t *columns,
                        Py_ssize_t count, Py_ssize_t tick, const Names *names, const TrackingParameters *parameters) {
    for (Py_ssize_t i = 0; i < count; i++) {
        Track *seen = tracks->track + rows[i];
        seen->seen_tick = tick;
        seen->seen_by_sensor |= new->is_own;
        seen->confirmed |= (double)(tick - seen->born_tick) >= parameters->confirmation_ticks ||
                           portable_hypot(seen->vx, seen->vy) > parameters->moving_speed;
    }
    for (Py_ssize_t i = 0; i < count; i++)
        if (!record_hit(names, tracks, (Py_ssize_t)rows[i], new, (Py_ssize_t)columns[i], parameters)) return false;
    return true;
}

static PyObject *perception_track_list_record_hits(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    TrackingParameters parameters;
    Names names;
    Array tracks, rows, columns;
    OpenMeasurements new;
    Py_ssize_t tick;
    if (!expect_arguments("record_hits", count, 7, 7) || !read_integer(arguments[4], &tick) ||
        !read_names(arguments[5], &names) || !read_tracking_parameters(arguments[6], &parameters) ||
        !open_tracks(arguments[0], &tracks))
        return NULL;
    PyObject *result = NULL;
    if (open_indices(arguments[1], tracks.count, &rows)) {
        if (open_measurements(arguments[2], &new)) {
            if (open_indices(arguments[3], new.count, &columns)) {
                Tracks seen = {.count = tracks.count};
                if (columns.count == rows.count) result = copy_tracks(tracks.data, tracks.count, &seen.track);
                else PyErr_SetString(PyExc_ValueError, "expected a column for each row");
                if (result && !record_hits(&seen, integers(&rows), &new, integers(&columns), rows.count, tick, &names,
                                           &parameters)) {
                    Py_DecRef(result);
                    result = NULL;
                }
                close_array(&columns);
            }
            close_measurements(&new);
        }
        close_array(&rows);
    }
    close_array(&tracks);
    return result;
}

/* With room for cost, possible pairs and blocks of `pairs`. */
static bool find_pairs(const Array *tracks, const OpenMeasurements *new, PyObject *number_by_name,
                       const TrackingParameters *parameters, Pairs *pairs) {
    size_t all = (size_t)(tracks->count * new->count), columns = (size_t)new->count;
    double *cost = malloc(all * (sizeof *cost + 1) + (columns + 1) * sizeof *pairs->block);
    if (!cost) return PyErr_NoMemory(), false;
    int64_t *block = (int64_t *)(cost + all);
    unsigned char *possible = (unsigned char *)(block + columns);
    for (size_t i = 0; i < columns; i++) block[i] = new->row[i].source;
    *pairs = (Pairs){
        .cost = cost, .possible = possible, .block = block, .rows = tracks->count, .columns = new->count};
    bool is_assigned = compare_tracks(tracks->data, tracks->count, new, number_by_name, parameters, cost, possible) &&
                       assign_pairs(pairs);
    free(cost);
    return is_assigned;
}

static PyObject *match_measurements(const Array *tracks, const OpenMeasurements *new, Py_ssize_t tick,
                                    const Names *names, const TrackingParameters *parameters) {
    Pairs pairs;
    if (!find_pairs(tracks, new, names->dictionary[NUMBER_BY_NAME], parameters, &pairs)) return NULL;
    Tracks seen = {.count = tracks->count};
    void *data;
    PyObject *first = copy_tracks(tracks->data, tracks->count, &seen.track);
    PyObject *second = first ? new_array('l', 1, &pairs.count, &data) : NULL;
    if (second) {
        if (pairs.count) memcpy(data, pairs.column, (size_t)pairs.count * sizeof *pairs.column);
        correct_tracks(seen.track, pairs.row, new->row, pairs.column, pairs.count, parameters);
        if (!record_hits(&seen, pairs.row, new, pairs.column, pairs.count, tick, names, parameters)) {
            Py_DecRef(second);
            second = NULL;
        }
    }
    free_pairs(&pairs);
    return pack(2, first, second);
}

static PyObject *perception_track_list_match_measurements(PyObject *module, PyObject *const *arguments,
                                                          Py_ssize_t count) {
    TrackingParameters parameters;
    Names names;
    Array tracks;
    OpenMeasurements new;
    Py_ssize_t tick;
    if (!expect_arguments("match_measurements", count, 5, 5) || !read_integer(arguments[2], &tick) ||
        !read_names(arguments[3], &names) || !read_tracking_parameters(arguments[4], &parameters) ||
        !open_tracks(arguments[0], &tracks))
        return NULL;
    PyObject *result = NULL;
    if (open_measurements(arguments[1], &new)) {
        result = match_measurements(&tracks, &new, tick, &names, &parameters);
        close_measurements(&new);
    }
    close_array(&tracks);
    return result;
}

static void update_mean(Track *track, Py_ssize_t tick, const TrackingParameters *parameters) {
    double radius = parameters->standstill_sigmas * sqrt(track->position) + parameters->standstill_m;
    bool has_left = portable_hypot(track->x - track->mean_x, track->y - track->mean_y) > radius;
    bool is_seen = track->seen_tick == tick;
    int64_t more = track->mean_count + is_seen, most = (int64_t)parameters->standstill_count;
    int64_t count = has_left ? 1 : more < most ? more : most;
    double share = has_left ? 1.0 : (double)is_seen / (double)count;
    track->mean_x += share * (track->x - track->mean_x);
    track->mean_y += share * (track->y - track->mean_y);
    track->mean_vx += share * (track->vx - track->mean_vx);
    track->mean_vy += share * (track->vy - track->mean_vy);
    track->mean_count = count;
    if (has_left) track->mean_tick = tick;
}

static bool is_standing(const Track *track, Py_ssize_t tick, const TrackingParameters *parameters) {
    double age = (double)(tick - track->mean_tick), count = age / parameters->correlation_ticks;
    count = count < 1.0 ? 1.0 : count > parameters->standstill_speeds ? parameters->standstill_speeds : count;
    double sigma = parameters->standstill_speed_sigmas * sqrt(track->velocity);
    return portable_hypot(track->vx, track->vy) <= sigma + parameters->speed_floor &&
           portable_hypot(track->mean_vx, track->mean_vy) <= sigma / sqrt(count) + parameters->speed_floor &&
           age >= parameters->standstill_ticks;
}

static bool is_kept(const Track *track, Py_ssize_t tick, const TrackingParameters *parameters) {
    double limit = parameters->tentative_ticks;
    if (track->confirmed)
        limit = is_standing(track, tick, parameters) ? parameters->standing_coasting_ticks : parameters->coasting_ticks;
    return (double)(tick - track->seen_tick) <= limit;
}

static PyObject *perception_track_list_end_update(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    TrackingParameters parameters;
    Array tracks;
    Py_ssize_t tick, kept = 0;
    if (!expect_arguments("end_update", count, 3, 3) || !read_integer(arguments[1], &tick) ||
        !read_tracking_parameters(arguments[2], &parameters) || !open_tracks(arguments[0], &tracks))
        return NULL;
    Track *track;
    PyObject *all = copy_tracks(tracks.data, tracks.count, &track), *result = all;
    for (Py_ssize_t i = 0; all && i < tracks.count; i++) {
        update_mean(track + i, tick, &parameters);
        if (is_kept(track + i, tick, &parameters)) track[kept++] = track[i];
    }
    if (all && kept < tracks.count) {
        result = copy_tracks(track, kept, &track);
        Py_DecRef(all);
    }
    close_array(&tracks);
    return result;
}

FIELDS(OWN_POSE, "x", "y", "yaw");
typedef struct {
    double x, y, yaw;
} OwnPose;

static bool is_lead(const Track *track, const OwnPose *own, CosSin heading, const TrackingParameters *parameters) {
    double dx = track->x - own->x, dy = track->y - own->y;
    double ahead = dx * heading.cos + dy * heading.sin, aside = dy * heading.cos - dx * heading.sin;
    return track->kind == VEHICLE && fabs(wrap_half_open(track->yaw - own->yaw)) < parameters->lead_yaw && ahead > 0 &&
           ahead < parameters->lead_m && fabs(aside) < parameters->lead_lateral_m;
}

/* A track as it is reported. */
typedef struct {
    Py_ssize_t row;
    double gap, x, y, speed;
} Shown;

/* By distance, NaN last, of equal ones by row: as a stable argsort. */
static int order_by_gap(const void *first, const void *second) {
    const Shown *one = first, *other = second;
    bool is_before = one->gap < other->gap || (isnan(other->gap) && !isnan(one->gap));
    bool is_after = other->gap < one->gap || (isnan(one->gap) && !isnan(other->gap));
    return is_before ? -1 : is_after ? 1 : one->row < other->row ? -1 : 1;
}

/* The id of a track: of its station, or of its own. */
static PyObject *build_name(PyObject *station_by_number, int64_t number) {
    PyObject *key = PyLong_FromLongLong(number);
    PyObject *station = key ? PyDict_GetItemWithError(station_by_number, key) : NULL;
    if (key) Py_DecRef(key);
    if (station) return new_reference(station);
    return PyErr_Occurred() ? NULL : PyUnicode_FromFormat("k%lld", (long long)number);
}

static PyObject *build_shown(const Track *tracks, const Shown *shown, Py_ssize_t count, PyObject *station_by_number) {
    NewRoadUsers users;
    if (!new_road_users(count, &users)) return NULL;
    for (Py_ssize_t i = 0; i < count; i++) {
        const Track *track = tracks + shown[i].row;
        PyObject *name = build_name(station_by_number, track->number);
        if (!name) {
            drop_road_users(&users);
            return NULL;
        }
        PyTuple_SetItem(users.ids, i, name);
        users.kinds[i] = (unsigned char)track->kind;
        double columns[USER_COLUMNS] = {shown[i].x,     shown[i].y,    track->yaw,
                                        shown[i].speed, track->length, track->width};
        for (int k = 0; k < USER_COLUMNS; k++) users.values[k][i] = columns[k];
    }
    double *nothing;
    return build_objects(&users, new_doubles(1, (Py_ssize_t[]){0}, &nothing));
}

static PyObject *list_objects(const Track *tracks, Py_ssize_t all, PyObject *station_by_number, Py_ssize_t tick,
                              const OwnPose *own, const TrackingParameters *parameters) {
    CosSin heading = cos_sin(own->yaw);
    bool is_finite = isfinite(heading.cos);
    Shown *shown = malloc((size_t)(all + 1) * sizeof *shown);
    if (!shown) return PyErr_NoMemory();
    Py_ssize_t count = 0;
    for (Py_ssize_t i = 0; i < all; i++) {
        const Track *track = tracks + i;
        if (!track->confirmed && !is_lead(track, own, heading, parameters)) continue;
        bool stands = is_standing(track, tick, parameters);
        double x = stands ? track->mean_x : track->x, y = stands ? track->mean_y : track->y;
        CosSin along = cos_sin(track->yaw);
        is_finite &= isfinite(along.cos);
        shown[count++] = (Shown){.row = i,
                                 .gap = portable_hypot(x - own->x, y - own->y),
                                 .x = x,
                                 .y = y,
                                 .speed = stands ? 0.0 : track->vx * along.cos + track->vy * along.sin};
    }
    qsort(shown, (size_t)count, sizeof *shown, order_by_gap);
    PyObject *result = is_finite ? build_shown(tracks, shown, count, station_by_number) : NULL;
    if (!is_finite) PyErr_SetString(PyExc_ValueError, "expected finite angles, found NaN or infinity");
    free(shown);
    return result;
}

static PyObject *perception_track_list_list_objects(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    TrackingParameters parameters;
    Array tracks;
    OwnPose own;
    Py_ssize_t tick;
    if (!expect_arguments("list_objects", count, 5, 5) || !read_integer(arguments[2], &tick) ||
        !read_fields(arguments[3], &OWN_POSE, &own.x) || !read_tracking_parameters(arguments[4], &parameters) ||
        !open_tracks(arguments[0], &tracks))
        return NULL;
    PyObject *result = list_objects(tracks.data, tracks.count, arguments[1], tick, &own, &parameters);
    close_array(&tracks);
    return result;
}

Functions perception_track_list = {
    FUNCTION(perception_track_list_compare),
    FUNCTION(perception_track_list_record_hits),
    FUNCTION(perception_track_list_match_measurements),
    FUNCTION(perception_track_list_end_update),
    FUNCTION(perception_track_list_list_objects),
    END_OF_FUNCTIONS,
};
