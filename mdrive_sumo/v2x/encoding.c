/* Twins of encoding.py: the bytes of the header, CAM and CPM, and points. All machines are little-endian. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "../contract/sensors.h"
#include "../core/portable.h"
#include "encoding.h"

enum { HEADER_BYTES = 18, CAM_BYTES = 11, CPM_BYTES = 5, OBJECT_BYTES = 21, MOST_OBJECTS = 255, MOST_SECTORS = 255 };
enum { LAST_KIND = STATIC };
static const double REACH_M = 327.67, CENTI = 100.0, DEGREES = 180.0 / PI, RADIANS = PI / 180.0;
static Import MESSAGE_ERROR = {"mdrive_sumo.v2x.content", "MessageError", 0},
              PARSE_TRACK_NAME = {"mdrive_sumo.v2x.content", "parse_track_name", 0},
              REFERENCE_POSE = {"mdrive_sumo.v2x.content", "ReferencePose", 0},
              CPM = {"mdrive_sumo.v2x.content", "Cpm", 0},
              CPM_PARTS = {"mdrive_sumo.v2x.encoding", "CpmParts", 0};
FIELDS(POSE, "x", "y", "yaw", "position_sigma", "yaw_sigma");
FIELDS(TICK, "tick");
FIELDS(NEW_POSE, "x", "y", "yaw", "tick", "position_sigma", "yaw_sigma");
FIELDS(CAM_FIELDS, "speed", "acceleration", "yaw_rate", "length", "width", "speed_sigma");
FIELDS(CPM_FIELDS, "pose", "range_m", "objects", "age", "roadside", "sigmas");
FIELDS(FREE, "ids", "free_m");

bool refuse_content(const char *text) {
    PyObject *error = find_import(&MESSAGE_ERROR);
    if (error) PyErr_SetString(error, text);
    return false;
}

bool round_and_clamp(double value, int bits, double least, long long *result) {
    double most = (double)((1LL << bits) - 1), rounded = round_even(value);
    if (!isfinite(value)) {
        PyObject *error = find_import(&MESSAGE_ERROR);
        const char *word = isnan(value) ? "nan" : value > 0 ? "inf" : "-inf";
        if (error) PyErr_Format(error, "expected finite numbers, found %s", word);
        return false;
    }
    rounded = rounded < -most ? -most : rounded > most ? most : rounded;
    *result = (long long)(rounded < least ? least : rounded);
    return true;
}

/* As Python's x % TAU. */
static double wrap_to_turn(double angle) {
    double rest = fmod(angle, TAU);
    return rest < 0.0 ? rest + TAU : rest;
}

bool read_pose(PyObject *object, Pose *pose) { return read_fields(object, &POSE, &pose->x); }

static PyObject *v2x_encoding_encode_header(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    Py_ssize_t kind, tick;
    Pose pose;
    if (!expect_arguments("encode_header", count, 2, 2) || !read_integer(arguments[0], &kind) ||
        !read_pose(arguments[1], &pose))
        return NULL;
    PyObject *tick_object = get_field(arguments[1], &TICK, 0);
    bool is_read = tick_object && read_integer(tick_object, &tick);
    if (is_read && (tick < 0 || tick > UINT32_MAX)) {
        PyObject *error = find_import(&MESSAGE_ERROR);
        if (error) PyErr_Format(error, "expected a tick from 0 to 4294967295, found %S", tick_object);
        is_read = false;
    }
    if (tick_object) Py_DecRef(tick_object);
    if (!is_read) return NULL;
    double yaw = round_even(wrap_to_turn(pose.yaw) * DEGREES * CENTI);
    if (isnan(yaw)) {
        PyErr_SetString(PyExc_ValueError, "cannot convert float NaN to integer");
        return NULL;
    }
    long long x, y, position_sigma, yaw_sigma;
    if (!round_and_clamp(pose.x * CENTI, 31, -INFINITY, &x) || !round_and_clamp(pose.y * CENTI, 31, -INFINITY, &y) ||
        !round_and_clamp(pose.position_sigma * CENTI, 16, 0.0, &position_sigma) ||
        !round_and_clamp(pose.yaw_sigma * DEGREES * 10, 8, 0.0, &yaw_sigma))
        return NULL;
    unsigned char bytes[HEADER_BYTES];
    Writer to = {bytes};
    write_8(&to, kind), write_32(&to, x), write_32(&to, y), write_16(&to, (long long)yaw % 36000);
    write_32(&to, tick), write_16(&to, position_sigma), write_8(&to, yaw_sigma);
    return PyBytes_FromStringAndSize((char *)bytes, HEADER_BYTES);
}

static PyObject *v2x_encoding_decode_pose(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    if (!expect_arguments("decode_pose", count, 1, 1)) return NULL;
    Py_ssize_t size = PyBytes_Size(arguments[0]);
    if (size < HEADER_BYTES) {
        if (size >= 0) PyErr_Format(PyExc_ValueError, "expected at least 18 bytes, found %zd", size);
        return NULL;
    }
    const unsigned char *from = (unsigned char *)PyBytes_AsString(arguments[0]);
    PyObject *values[] = {
        PyFloat_FromDouble((int32_t)read_32(from + 1) / CENTI),
        PyFloat_FromDouble((int32_t)read_32(from + 5) / CENTI),
        PyFloat_FromDouble(read_16(from + 9) / CENTI * RADIANS),
        PyLong_FromLongLong(read_32(from + 11)),
        PyFloat_FromDouble(read_16(from + 15) / CENTI),
        PyFloat_FromDouble(from[17] / 10.0 * RADIANS),
    };
    return build_instance(&REFERENCE_POSE, &NEW_POSE, values);
}

/* As encode_points, of one point; `direction` is that of -yaw. */
static bool encode_point(const Pose *pose, CosSin direction, double x, double y, Writer *to) {
    x -= pose->x, y -= pose->y;
    double ahead = x * direction.cos - y * direction.sin, left = x * direction.sin + y * direction.cos;
    if (!(fabs(ahead) <= REACH_M && fabs(left) <= REACH_M))
        return refuse_content("expected positions within 327.67 m of the sender, along and across");
    write_16(to, (long long)round_even(ahead * CENTI));
    write_16(to, (long long)round_even(left * CENTI));
    return true;
}

bool write_points(const Pose *pose, const Array *xy, Writer *to) {
    CosSin direction = cos_sin(-pose->yaw);
    if (xy->count % 2 || isnan(direction.cos)) {
        PyErr_SetString(PyExc_ValueError, "expected pairs of coordinates, and a finite yaw");
        return false;
    }
    for (Py_ssize_t i = 0; i < xy->count; i += 2)
        if (!encode_point(pose, direction, doubles(xy)[i], doubles(xy)[i + 1], to)) return false;
    return true;
}

static PyObject *v2x_encoding_encode_points(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    Pose pose;
    Array xy;
    if (!expect_arguments("encode_points", count, 2, 2) || !read_pose(arguments[0], &pose) ||
        !open_array(arguments[1], 'd', &xy))
        return NULL;
    PyObject *result = PyBytes_FromStringAndSize(NULL, 2 * xy.count);
    if (result && !write_points(&pose, &xy, &(Writer){(unsigned char *)PyBytes_AsString(result)})) {
        Py_DecRef(result);
        result = NULL;
    }
    close_array(&xy);
    return result;
}

/* As decode_points, of one point. */
static void decode_point(const Pose *pose, CosSin direction, const unsigned char *from, double *x, double *y) {
    double ahead = (int16_t)read_16(from) / CENTI, left = (int16_t)read_16(from + 2) / CENTI;
    *x = (ahead * direction.cos - left * direction.sin) + pose->x;
    *y = (ahead * direction.sin + left * direction.cos) + pose->y;
}

static PyObject *v2x_encoding_decode_points(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    Pose pose;
    if (!expect_arguments("decode_points", count, 2, 2) || !read_pose(arguments[0], &pose)) return NULL;
    CosSin direction = cos_sin(pose.yaw);
    Py_ssize_t size = PyBytes_Size(arguments[1]), shape[] = {size / 4, 2};
    if (size < 0 || size % 4 || isnan(direction.cos)) {
        if (!PyErr_Occurred()) PyErr_SetString(PyExc_ValueError, "expected 4 bytes a point, and a finite yaw");
        return NULL;
    }
    const unsigned char *from = (unsigned char *)PyBytes_AsString(arguments[1]);
    double *xy;
    PyObject *result = new_doubles(2, shape, &xy);
    for (Py_ssize_t i = 0; result && i < shape[0]; i++)
        decode_point(&pose, direction, from + 4 * i, xy + 2 * i, xy + 2 * i + 1);
    return result;
}

static PyObject *v2x_encoding_encode_high_frequency(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    double fields[6];
    if (!expect_arguments("encode_high_frequency", count, 2, 2) || !read_fields(arguments[0], &CAM_FIELDS, fields)) return NULL;
    unsigned char bytes[CAM_BYTES];
    Writer to = {bytes};
    long long value;
    for (int i = 0; i < 3; i++) {
        if (!round_and_clamp(fields[i] * (i < 2 ? CENTI : 1000), 15, -INFINITY, &value)) return NULL;
        write_16(&to, value);
    }
    for (int i = 3; i < 5; i++) {
        if (!round_and_clamp(fields[i] * CENTI, 16, 0.0, &value)) return NULL;
        write_16(&to, value);
    }
    if (!round_and_clamp(fields[5] * CENTI, 8, 0.0, &value)) return NULL;
    write_8(&to, value);
    return PyBytes_FromStringAndSize((char *)bytes, CAM_BYTES);
}

/* What a CPM consists of, opened for reading. */
typedef struct {
    RoadUsers objects;
    Array free_m, age, sigmas;
    Py_ssize_t range_dm, sectors;
    bool roadside;
} CpmInput;

static bool check_counts(PyObject *objects, Py_ssize_t *sectors) {
    PyObject *ids = get_field(objects, &FREE, 0), *free_m = ids ? get_field(objects, &FREE, 1) : NULL;
    Py_ssize_t count = ids ? PyObject_Size(ids) : -1;
    *sectors = free_m ? PyObject_Size(free_m) : -1;
    if (ids) Py_DecRef(ids);
    if (free_m) Py_DecRef(free_m);
    if (count < 0 || *sectors < 0) return false;
    if (count <= MOST_OBJECTS && *sectors <= MOST_SECTORS) return true;
    PyObject *error = find_import(&MESSAGE_ERROR);
    if (error)
        PyErr_Format(error, "expected at most %d objects and %d sectors, found %zd and %zd", (int)MOST_OBJECTS,
                     (int)MOST_SECTORS, count, *sectors);
    return false;
}

static bool open_field(PyObject *object, Fields *fields, int i, char kind, Array *array) {
    PyObject *field = get_field(object, fields, i);
    bool is_open = field && open_array(field, kind, array);
    if (field) Py_DecRef(field);
    return is_open;
}

static bool read_range(PyObject *cpm, CpmInput *input) {
    PyObject *range = get_field(cpm, &CPM_FIELDS, 1), *roadside = range ? get_field(cpm, &CPM_FIELDS, 4) : NULL;
    double range_m;
    long long range_dm;
    int is_roadside = roadside ? PyObject_IsTrue(roadside) : -1;
    bool is_read = is_roadside >= 0 && read_number(range, &range_m) &&
                   round_and_clamp(range_m * 10, 16, 0.0, &range_dm);
    if (range) Py_DecRef(range);
    if (roadside) Py_DecRef(roadside);
    if (!is_read) return false;
    input->range_dm = (Py_ssize_t)range_dm;
    input->roadside = is_roadside;
    return true;
}

static bool open_cpm(PyObject *cpm, CpmInput *input) {
    PyObject *objects = get_field(cpm, &CPM_FIELDS, 2);
    if (!objects) return false;
    Array *arrays[] = {&input->free_m, &input->age, &input->sigmas};
    int opened = 0;
    bool is_open = check_counts(objects, &input->sectors) && read_range(cpm, input) &&
                   open_road_users(objects, &input->objects);
    if (is_open) {
        is_open = open_field(objects, &FREE, 1, 'd', arrays[0]) && ++opened &&
                  open_field(cpm, &CPM_FIELDS, 3, 'l', arrays[1]) && ++opened &&
                  open_field(cpm, &CPM_FIELDS, 5, 'd', arrays[2]) && ++opened;
        if (!is_open) {
            close_arrays(opened, arrays);
            close_road_users(&input->objects);
        }
    }
    Py_DecRef(objects);
    return is_open;
}

static void close_cpm(CpmInput *input) {
    close_arrays(3, (Array *[]){&input->free_m, &input->age, &input->sigmas});
    close_road_users(&input->objects);
}

/* Yaws are those ahead of the pose: the difference of two finite ones can be infinite. */
static bool check_numbers(const CpmInput *input, const Pose *pose) {
    const RoadUsers *objects = &input->objects;
    for (Py_ssize_t i = 0; i < objects->count; i++)
        for (int k = 2; k < USER_COLUMNS; k++)
            if (!isfinite(doubles(objects->columns + k)[i] - (k == 2 ? pose->yaw : 0.0)))
                return refuse_content("expected finite numbers");
    for (Py_ssize_t i = 0; i < objects->count; i++)
        if (kinds_of(objects)[i] > LAST_KIND) return refuse_content("expected kinds from 0 to 3");
    PyObject *error = find_import(&MESSAGE_ERROR);
    if (!error) return false;
    if (input->age.dimensions != 1 || input->age.count != objects->count) {
        Py_ssize_t found = input->age.dimensions ? input->age.shape[0] : 0;
        PyErr_Format(error, "expected an age for each of %zd objects, found %zd", objects->count, found);
        return false;
    }
    const Array *sigmas = &input->sigmas;
    bool is_valid = sigmas->dimensions == 2 && sigmas->shape[0] == objects->count && sigmas->shape[1] == 3;
    for (Py_ssize_t i = 0; is_valid && i < sigmas->count; i++) is_valid = isfinite(doubles(sigmas)[i]);
    if (is_valid || (sigmas->dimensions && sigmas->shape[0] == 0)) return true;
    PyErr_Format(error, "expected finite standard deviations of shape (%zd, 3), found %zd numbers", objects->count,
                 sigmas->count);
    return false;
}

/* The number of a track named t and eight hexadecimal digits. */
static bool parse_track_name(PyObject *name, uint32_t *number) {
    Py_ssize_t size = 0;
    const char *text = name->ob_type == &PyUnicode_Type ? PyUnicode_AsUTF8AndSize(name, &size) : NULL;
    *number = 0;
    bool is_name = text && size == 9 && text[0] == 't';
    for (int i = 1; is_name && i < 9; i++) {
        char digit = text[i];
        is_name = (digit >= '0' && digit <= '9') || (digit >= 'a' && digit <= 'f');
        *number = *number << 4 | (uint32_t)(digit <= '9' ? digit - '0' : digit - 'a' + 10);
    }
    if (is_name) return true;
    PyErr_Clear();
    PyObject *parse = find_import(&PARSE_TRACK_NAME); /* which says what is wrong */
    PyObject *result = parse ? PyObject_CallFunctionObjArgs(parse, name, NULL) : NULL;
    if (result) {
        Py_DecRef(result);
        refuse_content("expected track names such as t0000002a");
    }
    return false;
}

static double clamp(double value, double low, double high) { return value < low ? low : value > high ? high : value; }

static bool encode_object(const CpmInput *input, Py_ssize_t i, const Pose *pose, CosSin direction, Writer *to) {
    static const double STEPS[] = {100.0, 10.0 * DEGREES, 100.0};
    const RoadUsers *objects = &input->objects;
    uint32_t track;
    if (!parse_track_name(PyTuple_GetItem(objects->ids, i), &track)) return false;
    write_32(to, track), write_8(to, kinds_of(objects)[i]);
    if (!encode_point(pose, direction, x_of(objects)[i], y_of(objects)[i], to)) return false;
    double yaw = round_even(wrap_to_turn(yaws_of(objects)[i] - pose->yaw) * DEGREES * CENTI);
    write_16(to, (long long)yaw % 36000);
    write_16(to, (long long)clamp(round_even(speeds_of(objects)[i] * CENTI), -32767, 32767));
    write_16(to, (long long)clamp(round_even(lengths_of(objects)[i] * CENTI), 0, 65535));
    write_16(to, (long long)clamp(round_even(widths_of(objects)[i] * CENTI), 0, 65535));
    int64_t age = ((const int64_t *)input->age.data)[i];
    write_8(to, age < 0 ? 0 : age > 255 ? 255 : age);
    for (int k = 0; k < 3; k++) {
        double sigma = input->sigmas.count ? doubles(&input->sigmas)[3 * i + k] : 0.0;
        write_8(to, (long long)clamp(round_even(sigma * STEPS[k]), 0, 255));
    }
    return true;
}

/* Rounded down; the slack makes encoding of decoded values exact. */
static bool encode_free_sight(const CpmInput *input, Writer *to) {
    double range_dm = (double)(input->range_dm > 1 ? input->range_dm : 1);
    for (Py_ssize_t i = 0; i < input->free_m.count; i++) {
        double free_m = doubles(&input->free_m)[i];
        if (!isfinite(free_m)) return refuse_content("expected finite numbers");
        write_8(to, (long long)floor(clamp(free_m * 10 / range_dm, 0, 1) * 255 + 1e-6));
    }
    return true;
}

static PyObject *write_cpm(const CpmInput *input, const Pose *pose) {
    CosSin direction = cos_sin(-pose->yaw);
    if (isnan(direction.cos)) refuse_content("expected a finite yaw");
    if (isnan(direction.cos) || !check_numbers(input, pose)) return NULL;
    Py_ssize_t count = input->objects.count, size = CPM_BYTES + count * OBJECT_BYTES + input->free_m.count;
    PyObject *result = PyBytes_FromStringAndSize(NULL, size);
    if (!result) return NULL;
    Writer to = {(unsigned char *)PyBytes_AsString(result)};
    write_16(&to, input->range_dm), write_8(&to, count), write_8(&to, input->sectors), write_8(&to, input->roadside);
    bool is_valid = true;
    for (Py_ssize_t i = 0; is_valid && i < count; i++) is_valid = encode_object(input, i, pose, direction, &to);
    if (is_valid && encode_free_sight(input, &to)) return result;
    Py_DecRef(result);
    return NULL;
}

static PyObject *v2x_encoding_encode_cpm(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    Pose pose;
    CpmInput input;
    if (!expect_arguments("encode_cpm", count, 2, 2) || !read_pose(arguments[1], &pose) ||
        !open_cpm(arguments[0], &input))
        return NULL;
    PyObject *result = NULL;
    if (input.free_m.dimensions == 1) result = write_cpm(&input, &pose);
    else PyErr_SetString(PyExc_ValueError, "expected free sight of one dimension");
    close_cpm(&input);
    return result;
}

static PyObject *v2x_encoding_parse_cpm(PyObject *module, PyObject *const *arguments, Py_ssize_t arguments_count) {
    if (!expect_arguments("parse_cpm", arguments_count, 1, 1)) return NULL;
    Py_ssize_t size = PyBytes_Size(arguments[0]);
    PyObject *error = find_import(&MESSAGE_ERROR), *type = find_import(&CPM_PARTS);
    if (size < 0 || !error || !type) return NULL;
    if (size < CPM_BYTES) return PyErr_Format(error, "expected at least 5 bytes after the header, found %zd", size);
    const unsigned char *body = (unsigned char *)PyBytes_AsString(arguments[0]);
    Py_ssize_t count = body[2], sectors = body[3], end = CPM_BYTES + count * OBJECT_BYTES;
    if (size != end + sectors)
        return PyErr_Format(error, "expected %zd bytes after the header, found %zd", end + sectors, size);
    bool is_valid = body[4] <= 1;
    for (Py_ssize_t i = 0; is_valid && i < count; i++) is_valid = body[CPM_BYTES + i * OBJECT_BYTES + 4] <= LAST_KIND;
    if (!is_valid) {
        refuse_content("expected kinds from 0 to 3, and 0 or 1 for a road-side unit");
        return NULL;
    }
    PyObject *values = pack(4, PyLong_FromLongLong(read_16(body)), PyBool_FromLong(body[4]),
                            PyBytes_FromStringAndSize((char *)body + CPM_BYTES, end - CPM_BYTES),
                            PyBytes_FromStringAndSize((char *)body + end, sectors));
    PyObject *parts = values ? PyObject_CallObject(type, values) : NULL;
    if (values) Py_DecRef(values);
    return parts;
}

/* What becomes a CPM; `sigmas` (count, 3). */
typedef struct {
    NewRoadUsers objects;
    PyObject *free_sight, *age, *sigmas;
    double *free_m, *sigma;
    unsigned char *ages;
} CpmOutput;

static bool new_cpm(Py_ssize_t count, Py_ssize_t sectors, CpmOutput *output) {
    Py_ssize_t shape[] = {count, 3};
    *output = (CpmOutput){0};
    if (!new_road_users(count, &output->objects)) return false;
    if ((output->free_sight = new_doubles(1, &sectors, &output->free_m)) &&
        (output->age = new_array('B', 1, &count, (void **)&output->ages)) &&
        (output->sigmas = new_doubles(2, shape, &output->sigma)))
        return true;
    if (output->free_sight) Py_DecRef(output->free_sight);
    if (output->age) Py_DecRef(output->age);
    drop_road_users(&output->objects);
    return false;
}

static bool decode_object(const unsigned char *from, Py_ssize_t i, const Pose *pose, CosSin direction,
                          CpmOutput *output) {
    static const double STEPS[] = {100.0, 10.0 * DEGREES, 100.0};
    NewRoadUsers *objects = &output->objects;
    char name[10];
    snprintf(name, sizeof name, "t%08x", read_32(from));
    PyObject *id = PyUnicode_FromString(name);
    if (!id || PyTuple_SetItem(objects->ids, i, id)) return false;
    objects->kinds[i] = from[4];
    decode_point(pose, direction, from + 5, objects->values[0] + i, objects->values[1] + i);
    objects->values[2][i] = read_16(from + 9) / CENTI * RADIANS + pose->yaw;
    objects->values[3][i] = (int16_t)read_16(from + 11) / CENTI;
    objects->values[4][i] = read_16(from + 13) / CENTI;
    objects->values[5][i] = read_16(from + 15) / CENTI;
    output->ages[i] = from[17];
    for (int k = 0; k < 3; k++) output->sigma[3 * i + k] = from[18 + k] / STEPS[k];
    return true;
}

static PyObject *build_cpm(PyObject *pose_object, const Pose *pose, Py_ssize_t range_dm, bool roadside, PyObject *rows,
                           PyObject *free_sight) {
    Py_ssize_t count = PyBytes_Size(rows) / OBJECT_BYTES, sectors = PyBytes_Size(free_sight);
    CosSin direction = cos_sin(pose->yaw);
    CpmOutput output;
    if (isnan(direction.cos)) refuse_content("expected a finite yaw");
    if (isnan(direction.cos) || !new_cpm(count, sectors, &output)) return NULL;
    const unsigned char *from = (unsigned char *)PyBytes_AsString(rows);
    const unsigned char *steps = (unsigned char *)PyBytes_AsString(free_sight);
    bool is_valid = true;
    for (Py_ssize_t i = 0; is_valid && i < count; i++)
        is_valid = decode_object(from + i * OBJECT_BYTES, i, pose, direction, &output);
    if (!is_valid) {
        Py_DecRef(output.free_sight), Py_DecRef(output.age), Py_DecRef(output.sigmas);
        drop_road_users(&output.objects);
        return NULL;
    }
    double range_m = (double)range_dm / 10;
    for (Py_ssize_t i = 0; i < sectors; i++) output.free_m[i] = steps[i] / 255.0 * range_m;
    PyObject *values[] = {new_reference(pose_object),
                          PyFloat_FromDouble(range_m),
                          build_objects(&output.objects, output.free_sight),
                          output.age,
                          PyBool_FromLong(roadside),
                          output.sigmas};
    return build_instance(&CPM, &CPM_FIELDS, values);
}

static PyObject *v2x_encoding_build_cpm(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    Pose pose;
    Py_ssize_t range_dm;
    if (!expect_arguments("build_cpm", count, 2, 2) || !read_pose(arguments[0], &pose)) return NULL;
    PyObject *parts[4];
    for (int i = 0; i < 4; i++)
        if (!(parts[i] = PyTuple_GetItem(arguments[1], i))) return NULL;
    int roadside = PyObject_IsTrue(parts[1]);
    if (roadside < 0 || !read_integer(parts[0], &range_dm)) return NULL;
    Py_ssize_t rows = PyBytes_Size(parts[2]);
    if (rows < 0 || rows % OBJECT_BYTES || PyBytes_Size(parts[3]) < 0) {
        if (!PyErr_Occurred()) PyErr_SetString(PyExc_ValueError, "expected 21 bytes an object");
        return NULL;
    }
    return build_cpm(arguments[0], &pose, range_dm, roadside, parts[2], parts[3]);
}

Functions v2x_encoding = {
    FUNCTION(v2x_encoding_encode_header),
    FUNCTION(v2x_encoding_decode_pose),
    FUNCTION(v2x_encoding_encode_points),
    FUNCTION(v2x_encoding_decode_points),
    FUNCTION(v2x_encoding_encode_high_frequency),
    FUNCTION(v2x_encoding_encode_cpm),
    FUNCTION(v2x_encoding_parse_cpm),
    FUNCTION(v2x_encoding_build_cpm),
    END_OF_FUNCTIONS,
};
