/* The frames of an episode as two metrics read them. */
#ifndef MDRIVE_FRAMES_H
#define MDRIVE_FRAMES_H

#include "../../core/compiled/values.h"
#include "../../core/geometry.h"

/* T frames of N road users, CAVs first: arrays (T, N), and (N,) of length and width. `speed` may be left out. */
typedef struct {
    Array x, y, yaw, speed, valid, length, width;
    Array *opened[7];
    int opened_count;
    Py_ssize_t frames, columns;
} Frames;

static inline bool open_frame_column(Frames *frames, PyObject *object, char kind, int dimensions, Array *array) {
    if (!open_array(object, kind, array)) return false;
    frames->opened[frames->opened_count++] = array;
    bool is_whole = array->dimensions == dimensions && array->shape[dimensions - 1] == frames->columns &&
                    (dimensions == 1 || array->shape[0] == frames->frames);
    if (!is_whole) PyErr_SetString(PyExc_ValueError, "expected the frames (T, N) of N road users");
    return is_whole;
}

static inline void close_frames(Frames *frames) { close_arrays(frames->opened_count, frames->opened); }

/* Arguments: x, y, yaw, speed (if there is one), valid, length, width, column. */
static inline bool open_frames(PyObject *const *arguments, bool has_speed, Frames *frames, Py_ssize_t *column) {
    frames->opened_count = 0;
    if (!open_doubles(arguments[0], 2, &frames->x)) return false;
    frames->opened[frames->opened_count++] = &frames->x;
    frames->frames = frames->x.shape[0], frames->columns = frames->x.shape[1];
    PyObject *const *rest = arguments + 3 + has_speed;
    bool are_open = open_frame_column(frames, arguments[1], 'd', 2, &frames->y) &&
                    open_frame_column(frames, arguments[2], 'd', 2, &frames->yaw) &&
                    (!has_speed || open_frame_column(frames, arguments[3], 'd', 2, &frames->speed)) &&
                    open_frame_column(frames, rest[0], '?', 2, &frames->valid) &&
                    open_frame_column(frames, rest[1], 'd', 1, &frames->length) &&
                    open_frame_column(frames, rest[2], 'd', 1, &frames->width) && read_integer(rest[3], column);
    if (are_open && (*column < 0 || *column >= frames->columns)) {
        PyErr_SetString(PyExc_ValueError, "expected the column of a road user");
        are_open = false;
    }
    if (!are_open) close_frames(frames);
    return are_open;
}

static inline bool is_valid(const Frames *frames, Py_ssize_t frame, Py_ssize_t column) {
    return ((const bool *)frames->valid.data)[frame * frames->columns + column];
}

static inline Box get_box(const Frames *frames, Py_ssize_t frame, Py_ssize_t column) {
    Py_ssize_t cell = frame * frames->columns + column;
    return box_corners(doubles(&frames->x)[cell], doubles(&frames->y)[cell], doubles(&frames->yaw)[cell],
                       doubles(&frames->length)[column], doubles(&frames->width)[column]);
}

static inline double get_radius(const Frames *frames, Py_ssize_t column) {
    return portable_hypot(doubles(&frames->length)[column], doubles(&frames->width)[column]) / 2;
}
#endif
