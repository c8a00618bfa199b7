/* Twin of moving_traffic.py. */
#include "../core/state.h"
#include "road_direction.h"

FIELDS(POSITION, "station", "lateral");
FIELDS(TRAVEL, "distance", "speed");

/* All arrays that the place of traffic depends on: road users, then times. */
enum { STATION, LATERAL, DISTANCE, SPEED, KEEPS_LANE, FORWARD, IN_OWN_LANE, AT_TIMES, ARRAYS };
enum { HEADWAY_S, STEP_S, GROWTH, SHARP_TURN_RAD, NUMBERS };
typedef struct {
    Road road;
    RoadUsers users;
    Array arrays[ARRAYS];
    int open;
    double numbers[NUMBERS];
} Traffic;

/* How a road user drives along the road until it has travelled so far. */
typedef struct {
    Point moved;
    double before, after;
    bool follows_turn;
} Drive;

static bool follow_road(const Traffic *traffic, Py_ssize_t user, double travelled, Drive *drive) {
    const Array *arrays = traffic->arrays;
    double here = doubles(arrays + STATION)[user], there = here + doubles(arrays + FORWARD)[user] * travelled;
    Point start, end;
    if (!find_road_point(&traffic->road, here, &start) || !find_road_point(&traffic->road, there, &end)) return false;
    drive->moved = (Point){end.x - start.x, end.y - start.y};
    drive->before = get_road_yaw(&traffic->road, here), drive->after = get_road_yaw(&traffic->road, there);
    drive->follows_turn = fabs(drive->after - drive->before) < traffic->numbers[SHARP_TURN_RAD];
    return true;
}

static bool place_user(const Traffic *traffic, Py_ssize_t row, Py_ssize_t user, Box *box, bool *follows_turn) {
    const RoadUsers *users = &traffic->users;
    const Array *arrays = traffic->arrays;
    Py_ssize_t state = row * users->count + user;
    double t = doubles(arrays + AT_TIMES)[row], speed = doubles(arrays + SPEED)[state], growth = 2 * traffic->numbers[GROWTH] * t;
    bool is_vehicle = kinds_of(users)[user] == VEHICLE, in_own_lane = flags(arrays + IN_OWN_LANE)[user];
    double travelled = is_vehicle ? doubles(arrays + DISTANCE)[state] : speeds_of(users)[user] * t;
    double gap = (in_own_lane ? traffic->numbers[HEADWAY_S] : 0.0) * speed, swept = in_own_lane ? 0.0 : speed * traffic->numbers[STEP_S];
    double yaw = yaws_of(users)[user], x = x_of(users)[user], y = y_of(users)[user];
    Drive drive;
    if (!follow_road(traffic, user, travelled, &drive)) return false;
    *follows_turn = drive.follows_turn;
    CosSin direction = cos_sin(yaw);
    if (flags(arrays + KEEPS_LANE)[user] && drive.follows_turn) {
        CosSin before = cos_sin(drive.before), after = cos_sin(drive.after);
        double lateral = doubles(arrays + LATERAL)[user];
        x = x + drive.moved.x - lateral * (after.sin - before.sin), y = y + drive.moved.y + lateral * (after.cos - before.cos);
        yaw = yaw + drive.after - drive.before;
    } else {
        x = x + travelled * direction.cos, y = y + travelled * direction.sin;
    }
    direction = cos_sin(yaw);
    return place_box(x - gap / 2 * direction.cos, y - gap / 2 * direction.sin, yaw,
                     lengths_of(users)[user] + gap + growth + swept, widths_of(users)[user] + growth, box);
}

static PyObject *place_all(const Traffic *traffic) {
    Py_ssize_t rows = traffic->arrays[AT_TIMES].count, count = traffic->users.count;
    double *corners;
    void *follows_turn;
    PyObject *boxes = new_doubles(4, (Py_ssize_t[]){rows, count, 4, 2}, &corners);
    PyObject *mask = new_array('?', 2, (Py_ssize_t[]){rows, count}, &follows_turn);
    bool are_placed = boxes && mask;
    for (Py_ssize_t i = 0; are_placed && i < rows * count; i++)
        are_placed = place_user(traffic, i / count, i % count, (Box *)corners + i, (bool *)follows_turn + i);
    if (are_placed) return pack(2, boxes, mask);
    if (boxes) Py_DecRef(boxes);
    if (mask) Py_DecRef(mask);
    return NULL;
}

static bool open_next(Traffic *traffic, PyObject *object, Fields *fields, int field, char kind, int dimensions) {
    Array *array = traffic->arrays + traffic->open;
    if (fields) {
        if (!open_field(object, fields, field, kind, dimensions, array)) return false;
    } else if (!open_array(object, kind, array)) {
        return false;
    }
    traffic->open++;
    Py_ssize_t users = traffic->users.count;
    if (array->dimensions == dimensions && (traffic->open > AT_TIMES || array->shape[dimensions - 1] == users)) return true;
    PyErr_SetString(PyExc_ValueError, "expected a number for each road user");
    return false;
}

/* (road, objects, position, travel, keeps_lane, forward, in_own_lane, times, headway_s, step_s, growth, sharp_turn_rad) */
static PyObject *place_traffic(Traffic *traffic, PyObject *const *arguments) {
    bool are_open = open_next(traffic, arguments[2], &POSITION, 0, 'd', 1) &&
                    open_next(traffic, arguments[2], &POSITION, 1, 'd', 1) &&
                    open_next(traffic, arguments[3], &TRAVEL, 0, 'd', 2) &&
                    open_next(traffic, arguments[3], &TRAVEL, 1, 'd', 2) &&
                    open_next(traffic, arguments[4], NULL, 0, '?', 1) && open_next(traffic, arguments[5], NULL, 0, 'd', 1) &&
                    open_next(traffic, arguments[6], NULL, 0, '?', 1) && open_next(traffic, arguments[7], NULL, 0, 'd', 1);
    PyObject *result = NULL;
    Py_ssize_t rows = are_open ? traffic->arrays[AT_TIMES].count : 0;
    if (are_open && (traffic->arrays[DISTANCE].shape[0] != rows || traffic->arrays[SPEED].shape[0] != rows))
        PyErr_SetString(PyExc_ValueError, "expected a travel for each time");
    else if (are_open)
        result = place_all(traffic);
    for (int i = 0; i < traffic->open; i++) close_array(traffic->arrays + i);
    return result;
}

static PyObject *planning_moving_traffic_place_traffic(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    Traffic traffic = {0};
    if (!expect_arguments("place_traffic", count, 12, 12) || !read_numbers(arguments + 8, NUMBERS, traffic.numbers) ||
        !open_road(arguments[0], &traffic.road))
        return NULL;
    PyObject *result = NULL;
    if (open_road_users(arguments[1], &traffic.users)) {
        result = place_traffic(&traffic, arguments);
        close_road_users(&traffic.users);
    }
    close_road(&traffic.road);
    return result;
}

Functions planning_moving_traffic = {
    FUNCTION(planning_moving_traffic_place_traffic),
    END_OF_FUNCTIONS,
};
