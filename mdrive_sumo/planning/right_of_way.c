/* Twins of right_of_way.py: what is on the own path, and what will cross it. */
#include <stdlib.h>
#include <string.h>

#include "../core/state.h"
#include "path_overlap.h"

FIELDS(PARAMETERS, "look_ahead_m", "stride_m", "side_gap_m", "moving_speed", "same_direction_rad", "level_m");
enum { LOOK_AHEAD_M, STRIDE_M, SIDE_GAP_M, MOVING_SPEED, SAME_DIRECTION_RAD, LEVEL_M, NUMBERS };
FIELDS(ANGLES, "side_angles_rad", "max_turn_rad");
FIELDS(BENDS, "moving_speed", "max_curvature");
FIELDS(CAR, "length", "width");
FIELDS(EGO, "position");
FIELDS(PREVIEW, "distance", "yaw", "boxes");
FIELDS(LEAD, "gap_m", "speed", "id", "position");
FIELDS(CONFLICT, "id", "begin_m", "end_m", "arrives_s", "leaves_s", "is_standing", "bearing", "ego_turns", "position");
static Import DEFAULTS = {"mdrive_sumo.planning.parameters", "RIGHT_OF_WAY", 0};
static Import PATH_PREVIEW = {"mdrive_sumo.planning.right_of_way", "PathPreview", 0};
static Import LEAD_OBJECT = {"mdrive_sumo.planning.right_of_way", "LeadObject", 0};
static Import CROSSING_CONFLICT = {"mdrive_sumo.planning.right_of_way", "CrossingConflict", 0};

static bool read_parameters(PyObject *const *arguments, Py_ssize_t count, int place, double *numbers) {
    PyObject *parameters = count > place ? arguments[place] : find_import(&DEFAULTS);
    return parameters && read_fields(parameters, &PARAMETERS, numbers);
}

static PyObject *planning_right_of_way_preview_path(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    double numbers[NUMBERS], car[2], s;
    if (!expect_arguments("preview_path", count, 3, 4) || !read_parameters(arguments, count, 3, numbers) ||
        !read_number(arguments[1], &s) || !read_fields(arguments[2], &CAR, car))
        return NULL;
    Path path;
    if (!open_path(arguments[0], &path)) return NULL;
    Py_ssize_t rows = count_range(0.0, numbers[LOOK_AHEAD_M], numbers[STRIDE_M]);
    double *distance = NULL, *yaw = NULL, *corners = NULL;
    PyObject *values[] = {new_doubles(1, &rows, &distance), new_doubles(1, &rows, &yaw),
                          new_doubles(3, (Py_ssize_t[]){rows, 4, 2}, &corners)};
    bool are_placed = values[0] && values[1] && values[2];
    for (Py_ssize_t row = 0; are_placed && row < rows; row++) {
        distance[row] = get_range_element(0.0, numbers[STRIDE_M], row);
        int64_t cell = find_cell(&path, s + distance[row]);
        yaw[row] = doubles(&path.yaw)[cell];
        are_placed = place_footprints(&path, &cell, 1, car[0], car[1] + 2 * numbers[SIDE_GAP_M], (Box *)corners + row);
    }
    close_path(&path);
    if (are_placed) return build_instance(&PATH_PREVIEW, &PREVIEW, values);
    for (int i = 0; i < 3; i++)
        if (values[i]) Py_DecRef(values[i]);
    return NULL;
}

/* A path ahead with at least one station, and the road users that are compared with it. */
typedef struct {
    Array distance, yaw, boxes;
    RoadUsers users;
} Scene;

static bool open_preview(PyObject *preview, Scene *scene) {
    if (!open_field(preview, &PREVIEW, 0, 'd', 1, &scene->distance)) return false;
    if (!open_field(preview, &PREVIEW, 1, 'd', 1, &scene->yaw)) {
        close_array(&scene->distance);
        return false;
    }
    PyObject *boxes = get_field(preview, &PREVIEW, 2);
    bool is_open = boxes && open_boxes(boxes, &scene->boxes);
    if (boxes) Py_DecRef(boxes);
    if (!is_open) {
        close_arrays(2, (Array *[]){&scene->distance, &scene->yaw});
        return false;
    }
    if (scene->yaw.count && scene->yaw.count == scene->distance.count && scene->boxes.shape[0] == scene->yaw.count) return true;
    PyErr_SetString(PyExc_ValueError, "expected a preview of at least one station");
    close_arrays(3, (Array *[]){&scene->distance, &scene->yaw, &scene->boxes});
    return false;
}

static bool open_scene(PyObject *preview, PyObject *objects, Scene *scene) {
    if (!open_preview(preview, scene)) return false;
    if (open_road_users(objects, &scene->users)) return true;
    close_arrays(3, (Array *[]){&scene->distance, &scene->yaw, &scene->boxes});
    return false;
}

static void close_scene(Scene *scene) {
    close_arrays(3, (Array *[]){&scene->distance, &scene->yaw, &scene->boxes});
    close_road_users(&scene->users);
}

static bool read_position(PyObject *ego, Point *position) {
    PyObject *pair = get_field(ego, &EGO, 0);
    PyObject *x = pair ? PySequence_GetItem(pair, 0) : NULL, *y = x ? PySequence_GetItem(pair, 1) : NULL;
    bool is_read = y && read_number(x, &position->x) && read_number(y, &position->y);
    if (y) Py_DecRef(y);
    if (x) Py_DecRef(x);
    if (pair) Py_DecRef(pair);
    return is_read;
}

/* The cosine, in an error false: a heading that is no number. */
static bool find_cosine(double angle, double *cosine) {
    *cosine = cos_sin(angle).cos;
    if (isfinite(*cosine)) return true;
    PyErr_SetString(PyExc_ValueError, "expected finite headings, found NaN or infinity");
    return false;
}

static bool mark_same_direction(const Scene *scene, const double *numbers, bool *mask) {
    double least_cosine, cosine;
    if (!find_cosine(numbers[SAME_DIRECTION_RAD], &least_cosine)) return false;
    for (Py_ssize_t row = 0; row < scene->users.count; row++) {
        if (!find_cosine(yaws_of(&scene->users)[row] - doubles(&scene->yaw)[0], &cosine)) return false;
        mask[row] = cosine > least_cosine;
    }
    return true;
}

/* As boxes[0].mean(0). */
static Point find_centre(const Scene *scene) {
    const Point *corner = boxes_of(&scene->boxes)->corner;
    return (Point){(corner[0].x + corner[1].x + corner[2].x + corner[3].x) / 4,
                   (corner[0].y + corner[1].y + corner[2].y + corner[3].y) / 4};
}

static bool mark_followers_beside(const Scene *scene, Point ego, const double *numbers, bool *mask) {
    if (!mark_same_direction(scene, numbers, mask)) return false;
    CosSin ahead = cos_sin(doubles(&scene->yaw)[0]);
    Point centre = find_centre(scene);
    const double *x = x_of(&scene->users), *y = y_of(&scene->users), level_m = numbers[LEVEL_M];
    for (Py_ssize_t row = 0; row < scene->users.count; row++) {
        double lead = (x[row] - centre.x) * ahead.cos + (y[row] - centre.y) * ahead.sin;
        bool further_east = x[row] > ego.x || (x[row] == ego.x && y[row] > ego.y);
        mask[row] = mask[row] && (lead < -level_m || (lead < level_m && further_east));
    }
    return true;
}

/* The first station after the present one that each road user occupies now, 0 for none. */
static bool find_stations_now(const Scene *scene, Py_ssize_t *first) {
    Py_ssize_t stations = scene->boxes.shape[0] - 1;
    Py_ssize_t *rows = malloc((size_t)(stations + 1) * sizeof *rows);
    BoxSet set = {0};
    bool are_found = rows && measure_boxes(&set, boxes_of(&scene->boxes) + 1, stations);
    if (!rows) PyErr_NoMemory();
    const RoadUsers *users = &scene->users;
    for (Py_ssize_t row = 0; are_found && row < users->count; row++) {
        Box box;
        are_found = place_box(x_of(users)[row], y_of(users)[row], yaws_of(users)[row], lengths_of(users)[row],
                              widths_of(users)[row], &box);
        if (!are_found) break;
        Circle circle = measure_box(&box);
        first[row] = find_overlapping(&set, &box, &circle, rows) ? rows[0] + 1 : 0;
    }
    release_boxes(&set);
    free(rows);
    return are_found;
}

/* (ego, preview, objects, parameters) with two columns: first station, whether it follows beside. */
typedef struct {
    Scene scene;
    Point ego;
    double numbers[NUMBERS];
    Py_ssize_t *first;
    bool *follows;
} Present;

static void close_present(Present *now) {
    close_scene(&now->scene);
    free(now->first), free(now->follows);
}

static bool open_present(PyObject *const *arguments, Py_ssize_t count, bool finds_stations, Present *now) {
    if (!expect_arguments("right of way", count, 3, 4) || !read_parameters(arguments, count, 3, now->numbers) ||
        !read_position(arguments[0], &now->ego) || !open_scene(arguments[1], arguments[2], &now->scene))
        return false;
    size_t users = (size_t)now->scene.users.count + 1;
    now->first = calloc(users, sizeof *now->first), now->follows = calloc(users, sizeof *now->follows);
    if (!now->first || !now->follows) PyErr_NoMemory();
    else if (mark_followers_beside(&now->scene, now->ego, now->numbers, now->follows) &&
             (!finds_stations || find_stations_now(&now->scene, now->first)))
        return true;
    close_present(now);
    return false;
}

static PyObject *build_lead_object(const Present *now, Py_ssize_t row) {
    const RoadUsers *users = &now->scene.users;
    Py_ssize_t station = now->first[row];
    double cosine, x = x_of(users)[row], y = y_of(users)[row];
    if (!find_cosine(yaws_of(users)[row] - doubles(&now->scene.yaw)[station], &cosine)) return NULL;
    double along = speeds_of(users)[row] * cosine;
    PyObject *values[] = {PyFloat_FromDouble(doubles(&now->scene.distance)[station]),
                          PyFloat_FromDouble(along > 0.0 ? along : 0.0),
                          new_reference(PyTuple_GetItem(users->ids, row)), build_tuple(2, (double[]){x, y})};
    return build_instance(&LEAD_OBJECT, &LEAD, values);
}

static PyObject *planning_right_of_way_find_lead_objects(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    Present now;
    if (!open_present(arguments, count, true, &now)) return NULL;
    PyObject *list = PyList_New(0);
    for (Py_ssize_t row = 0; list && row < now.scene.users.count; row++) {
        if (!now.first[row] || now.follows[row]) continue;
        PyObject *lead = build_lead_object(&now, row);
        if (!lead || PyList_Append(list, lead)) Py_DecRef(list), list = NULL;
        if (lead) Py_DecRef(lead);
    }
    close_present(&now);
    return list;
}

static PyObject *planning_right_of_way_find_rows_on_path(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    Present now;
    if (!open_present(arguments, count, true, &now)) return NULL;
    Py_ssize_t found = 0, users = now.scene.users.count;
    for (Py_ssize_t row = 0; row < users; row++) found += now.first[row] && !now.follows[row];
    void *data;
    PyObject *rows = new_array('l', 1, &found, &data);
    int64_t *next = data;
    for (Py_ssize_t row = 0; rows && row < users; row++)
        if (now.first[row] && !now.follows[row]) *next++ = row;
    close_present(&now);
    return rows;
}

static PyObject *planning_right_of_way_find_followers_beside(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    Present now;
    if (!open_present(arguments, count, false, &now)) return NULL;
    void *mask;
    PyObject *result = new_array('?', 1, &now.scene.users.count, &mask);
    if (result) memcpy(mask, now.follows, (size_t)now.scene.users.count);
    close_present(&now);
    return result;
}

static PyObject *planning_right_of_way_find_same_direction(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    double numbers[NUMBERS];
    Scene scene;
    if (!expect_arguments("find_same_direction", count, 2, 3) || !read_parameters(arguments, count, 2, numbers) ||
        !open_scene(arguments[0], arguments[1], &scene))
        return NULL;
    void *mask;
    PyObject *result = new_array('?', 1, &scene.users.count, &mask);
    if (result && !mark_same_direction(&scene, numbers, mask)) Py_DecRef(result), result = NULL;
    close_scene(&scene);
    return result;
}

/* What a conflict says of parameters beside their numbers. */
typedef struct {
    double numbers[NUMBERS], turn_rad, max_turn_rad;
} Crossing;

static bool read_crossing(PyObject *const *arguments, Py_ssize_t count, Crossing *crossing) {
    PyObject *defaults = find_import(&DEFAULTS), *parameters = count > 3 ? arguments[3] : defaults;
    if (!defaults || !read_fields(parameters, &PARAMETERS, crossing->numbers)) return false;
    PyObject *angles = get_field(parameters, &ANGLES, 0), *low = angles ? PySequence_GetItem(angles, 0) : NULL;
    bool is_read = low && read_number(low, &crossing->turn_rad);
    if (low) Py_DecRef(low);
    if (angles) Py_DecRef(angles);
    return is_read && read_number_field(defaults, &ANGLES, 1, &crossing->max_turn_rad);
}

/* The extremes of own stations and of strides of another road user that overlap. */
typedef struct {
    Py_ssize_t mine[2], theirs[2];
} Shared;

/* As the box of _predict_boxes after `travelled` [m]: on a chord of that length, exact for small turns, and large turns
   are guesses anyway. */
static bool place_on_chord(const RoadUsers *users, Py_ssize_t row, double travelled, double curvature, double most, Box *box) {
    double turned = curvature * travelled, yaw = yaws_of(users)[row];
    turned = turned < -most ? -most : turned > most ? most : turned;
    CosSin chord = cos_sin(yaw + turned / 2);
    return place_box(x_of(users)[row] + travelled * chord.cos, y_of(users)[row] + travelled * chord.sin, yaw + turned,
                     lengths_of(users)[row], widths_of(users)[row], box);
}

/* Whether an object shares an area with the own path; *is_placed is false in an error. */
static bool find_shared(const Scene *scene, const BoxSet *set, Py_ssize_t row, double curvature, const Crossing *crossing,
                        Py_ssize_t *rows, Shared *shared, bool *is_placed) {
    double stride_m = crossing->numbers[STRIDE_M];
    Py_ssize_t strides = count_range(0.0, crossing->numbers[LOOK_AHEAD_M], stride_m);
    *shared = (Shared){{set->count, -1}, {strides, -1}};
    for (Py_ssize_t stride = 0; stride < strides; stride++) {
        Box box;
        double travelled = get_range_element(0.0, stride_m, stride);
        *is_placed = place_on_chord(&scene->users, row, travelled, curvature, crossing->max_turn_rad, &box);
        if (!*is_placed) return false;
        Circle circle = measure_box(&box);
        Py_ssize_t found = find_overlapping(set, &box, &circle, rows);
        if (!found) continue;
        if (stride < shared->theirs[0]) shared->theirs[0] = stride;
        shared->theirs[1] = stride;
        if (rows[0] < shared->mine[0]) shared->mine[0] = rows[0];
        if (rows[found - 1] > shared->mine[1]) shared->mine[1] = rows[found - 1];
    }
    return shared->theirs[1] >= 0;
}

static PyObject *build_conflict(const Scene *scene, Py_ssize_t row, const Shared *shared, const Crossing *crossing) {
    const RoadUsers *users = &scene->users;
    const double *distance = doubles(&scene->distance), *yaw = doubles(&scene->yaw);
    double speed = speeds_of(users)[row], x = x_of(users)[row], y = y_of(users)[row];
    double stride_m = crossing->numbers[STRIDE_M], moving_speed = crossing->numbers[MOVING_SPEED];
    bool is_standing = speed < moving_speed;
    if (is_standing) speed = moving_speed;
    PyObject *values[] = {
        new_reference(PyTuple_GetItem(users->ids, row)),
        PyFloat_FromDouble(distance[shared->mine[0]]),
        PyFloat_FromDouble(distance[shared->mine[1]]),
        PyFloat_FromDouble((double)shared->theirs[0] * stride_m / speed),
        PyFloat_FromDouble((double)(shared->theirs[1] + 1) * stride_m / speed),
        PyBool_FromLong(is_standing),
        PyFloat_FromDouble(wrap_angle(yaws_of(users)[row] - yaw[0])),
        PyBool_FromLong(fabs(yaw[shared->mine[0]] - yaw[0]) > crossing->turn_rad),
        build_tuple(2, (double[]){x, y}),
    };
    return build_instance(&CROSSING_CONFLICT, &CONFLICT, values);
}

static PyObject *list_conflicts(const Scene *scene, const BoxSet *set, const double *curvature, const Crossing *crossing,
                                Py_ssize_t *rows) {
    PyObject *list = PyList_New(0);
    Point centre = find_centre(scene);
    for (Py_ssize_t row = 0; list && row < scene->users.count; row++) {
        double gap_m = portable_hypot(centre.x - x_of(&scene->users)[row], centre.y - y_of(&scene->users)[row]);
        if (!(gap_m < crossing->numbers[LOOK_AHEAD_M]) || kinds_of(&scene->users)[row] == STATIC) continue;
        Shared shared;
        bool is_placed = true;
        if (!find_shared(scene, set, row, curvature[row], crossing, rows, &shared, &is_placed) && is_placed) continue;
        PyObject *conflict = is_placed ? build_conflict(scene, row, &shared, crossing) : NULL;
        if (!conflict || PyList_Append(list, conflict)) Py_DecRef(list), list = NULL;
        if (conflict) Py_DecRef(conflict);
    }
    return list;
}

static PyObject *planning_right_of_way_find_crossing_conflicts(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    Crossing crossing;
    Scene scene;
    Array curvature;
    if (!expect_arguments("find_crossing_conflicts", count, 3, 4) || !read_crossing(arguments, count, &crossing) ||
        !open_doubles(arguments[2], 1, &curvature))
        return NULL;
    if (!open_scene(arguments[0], arguments[1], &scene)) {
        close_array(&curvature);
        return NULL;
    }
    PyObject *result = NULL;
    BoxSet set = {0};
    Py_ssize_t *rows = malloc((size_t)scene.boxes.shape[0] * sizeof *rows);
    if (curvature.count != scene.users.count) PyErr_SetString(PyExc_ValueError, "expected one curvature for each object");
    else if (!rows) PyErr_NoMemory();
    else if (measure_boxes(&set, boxes_of(&scene.boxes), scene.boxes.shape[0]))
        result = list_conflicts(&scene, &set, doubles(&curvature), &crossing, rows);
    release_boxes(&set);
    free(rows);
    close_array(&curvature);
    close_scene(&scene);
    return result;
}

/* The curvature of one object's path; its heading goes into `headings`. */
static bool estimate_curvature(const RoadUsers *users, Py_ssize_t row, PyObject *before, const double *numbers,
                               PyObject *headings, double *curvature) {
    double yaw = yaws_of(users)[row], earlier = yaw, speed = fabs(speeds_of(users)[row]), elapsed_s = numbers[2];
    PyObject *id = PyTuple_GetItem(users->ids, row), *known = PyDict_GetItemWithError(before, id);
    PyObject *heading = PyFloat_FromDouble(yaw);
    bool is_kept = heading && !PyDict_SetItem(headings, id, heading) && !PyErr_Occurred();
    if (heading) Py_DecRef(heading);
    if (!is_kept || (known && !read_number(known, &earlier))) return false;
    if (isinf(yaw - earlier)) {
        PyErr_SetString(PyExc_ValueError, "expected finite headings, found infinity");
        return false;
    }
    double least_speed = 2 * numbers[0], travelled = (speed < least_speed ? least_speed : speed) * elapsed_s;
    double bend = wrap_angle(yaw - earlier) / travelled;
    *curvature = bend < -numbers[1] ? -numbers[1] : bend > numbers[1] ? numbers[1] : bend;
    return true;
}

static PyObject *planning_right_of_way_estimate_curvatures(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    double numbers[3]; /* moving speed, maximum curvature, elapsed time */
    RoadUsers users;
    if (!expect_arguments("estimate_curvatures", count, 4, 4) || !read_fields(arguments[3], &BENDS, numbers) ||
        !read_number(arguments[2], numbers + 2) || !open_road_users(arguments[0], &users))
        return NULL;
    double *curvature;
    PyObject *result = new_doubles(1, &users.count, &curvature), *headings = PyDict_New();
    bool are_estimated = result && headings;
    for (Py_ssize_t row = 0; are_estimated && row < users.count; row++)
        are_estimated = estimate_curvature(&users, row, arguments[1], numbers, headings, curvature + row);
    close_road_users(&users);
    if (are_estimated) return pack(2, result, headings);
    if (result) Py_DecRef(result);
    if (headings) Py_DecRef(headings);
    return NULL;
}

Functions planning_right_of_way = {
    FUNCTION(planning_right_of_way_preview_path),
    FUNCTION(planning_right_of_way_find_lead_objects),
    FUNCTION(planning_right_of_way_find_rows_on_path),
    FUNCTION(planning_right_of_way_find_followers_beside),
    FUNCTION(planning_right_of_way_find_same_direction),
    FUNCTION(planning_right_of_way_find_crossing_conflicts),
    FUNCTION(planning_right_of_way_estimate_curvatures),
    END_OF_FUNCTIONS,
};
