/* Twins of motion_conflicts.py: all boxes of all motions in one call. */
#include <stdlib.h>
#include <string.h>

#include "motion_prediction.h"

FIELDS(MOTION, "poses", "length", "width", "min_gap_m", "stands_at_end");
FIELDS(PREDICTED, "corners", "begin", "end", "min_gap_m", "motion");
FIELDS(SIZE, "length", "width");
FIELDS(MARGIN, "longitudinal", "lateral");
static Import PREDICTED_BOXES = {"mdrive_sumo.planning.motion_conflicts", "PredictedBoxes", 0};

/* The boxes of `list_predicted_boxes` while they are collected. */
typedef struct {
    Py_ssize_t count, size;
    Box *corners;
    int64_t *begin, *end, *motion;
    double *min_gap_m;
} Collected;

static bool reserve(Collected *all, Py_ssize_t more) {
    if (all->count + more <= all->size) return true;
    Py_ssize_t size = 2 * all->size + more;
    Collected larger = {all->count,
                        size,
                        malloc((size_t)size * sizeof(Box)),
                        malloc((size_t)size * sizeof(int64_t)),
                        malloc((size_t)size * sizeof(int64_t)),
                        malloc((size_t)size * sizeof(int64_t)),
                        malloc((size_t)size * sizeof(double))};
    bool is_reserved = larger.corners && larger.begin && larger.end && larger.motion && larger.min_gap_m;
    Collected old = *all;
    if (is_reserved) {
        size_t count = (size_t)all->count;
        if (count) {
            memcpy(larger.corners, all->corners, count * sizeof(Box));
            memcpy(larger.begin, all->begin, count * sizeof(int64_t));
            memcpy(larger.end, all->end, count * sizeof(int64_t));
            memcpy(larger.motion, all->motion, count * sizeof(int64_t));
            memcpy(larger.min_gap_m, all->min_gap_m, count * sizeof(double));
        }
        *all = larger;
    } else {
        old = larger;
        PyErr_NoMemory();
    }
    free(old.corners), free(old.begin), free(old.end), free(old.motion), free(old.min_gap_m);
    return is_reserved;
}

typedef struct {
    double width, min_gap_m, stands_at_end;
} MotionFacts;

/* The boxes of one motion: one for all rows at which it stays where it is. */
static bool add_boxes(Collected *all, Py_ssize_t motion, const Array *poses, const Array *length, const MotionFacts *facts) {
    Py_ssize_t rows = poses->shape[0], step = length->count == 1 ? 0 : 1;
    if (poses->shape[1] != 3 || (step && length->count != rows)) {
        PyErr_SetString(PyExc_ValueError, "expected poses (T, 3) and one length or T lengths");
        return false;
    }
    if (!reserve(all, rows)) return false;
    const double *before = NULL;
    for (Py_ssize_t row = 0; row < rows; row++) {
        const double *pose = doubles(poses) + 3 * row;
        double long_m = doubles(length)[row * step];
        bool moves = !before || pose[0] != before[0] || pose[1] != before[1] || pose[2] != before[2] ||
                     long_m != doubles(length)[(row - 1) * step];
        before = pose;
        if (!moves) continue;
        if (row) all->end[all->count - 1] = row;
        if (!place_box(pose[0], pose[1], pose[2], long_m, facts->width, all->corners + all->count)) return false;
        all->begin[all->count] = row, all->motion[all->count] = motion, all->min_gap_m[all->count] = facts->min_gap_m;
        all->count++;
    }
    if (rows) all->end[all->count - 1] = facts->stands_at_end ? TIMES + 1 : rows;
    return true;
}

static bool add_motion(Collected *all, Py_ssize_t number, PyObject *motion) {
    MotionFacts facts;
    Array poses, length;
    if (!read_number_field(motion, &MOTION, 2, &facts.width) || !read_number_field(motion, &MOTION, 3, &facts.min_gap_m) ||
        !read_number_field(motion, &MOTION, 4, &facts.stands_at_end) || !open_field(motion, &MOTION, 0, 'd', 2, &poses))
        return false;
    PyObject *value = get_field(motion, &MOTION, 1);
    bool is_added = value && open_array(value, 'd', &length);
    if (value) Py_DecRef(value);
    if (is_added) {
        is_added = add_boxes(all, number, &poses, &length, &facts);
        close_array(&length);
    }
    close_array(&poses);
    return is_added;
}

static PyObject *copy_column(char kind, Py_ssize_t count, const void *column) {
    void *data;
    PyObject *array = new_array(kind, 1, &count, &data);
    if (array && count) memcpy(data, column, (size_t)count * 8);
    return array;
}

static PyObject *build_predicted(const Collected *all) {
    double *corners;
    PyObject *boxes = new_doubles(3, (Py_ssize_t[]){all->count, 4, 2}, &corners);
    if (boxes && all->count) memcpy(corners, all->corners, (size_t)all->count * sizeof(Box));
    PyObject *values[] = {boxes, copy_column('l', all->count, all->begin), copy_column('l', all->count, all->end),
                          copy_column('d', all->count, all->min_gap_m), copy_column('l', all->count, all->motion)};
    return build_instance(&PREDICTED_BOXES, &PREDICTED, values);
}

static PyObject *planning_motion_conflicts_list_predicted_boxes(PyObject *module, PyObject *const *arguments,
                                                                Py_ssize_t count) {
    if (!expect_arguments("list_predicted_boxes", count, 1, 1)) return NULL;
    Collected all = {0};
    Py_ssize_t motions = PyObject_Size(arguments[0]);
    bool are_added = motions >= 0;
    for (Py_ssize_t i = 0; are_added && i < motions; i++) {
        PyObject *motion = PySequence_GetItem(arguments[0], i);
        are_added = motion && add_motion(&all, i, motion);
        if (motion) Py_DecRef(motion);
    }
    PyObject *result = are_added ? build_predicted(&all) : NULL;
    free(all.corners), free(all.begin), free(all.end), free(all.motion), free(all.min_gap_m);
    return result;
}

/* What a test for conflicts takes: the own path, size, margin and cells, and the predicted boxes. */
typedef struct {
    Path path;
    Array corners, begin, end, min_gap_m, motion, cells;
    double length, width, longitudinal, lateral;
    Box *own;
    BoxSet set;
    Py_ssize_t *rows;
} Conflicts;

static bool open_predicted(PyObject *predicted, Conflicts *now) {
    PyObject *corners = get_field(predicted, &PREDICTED, 0);
    bool is_open = corners && open_boxes(corners, &now->corners);
    if (corners) Py_DecRef(corners);
    if (!is_open) return false;
    Array *columns[] = {&now->corners, &now->begin, &now->end, &now->min_gap_m, &now->motion};
    for (int i = 1; i < 5; i++)
        if (!open_field(predicted, &PREDICTED, i, i == 3 ? 'd' : 'l', 1, columns[i])) {
            close_arrays(i, columns);
            return false;
        }
    Py_ssize_t count = now->corners.shape[0];
    if (now->begin.count == count && now->end.count == count && now->min_gap_m.count == count && now->motion.count == count)
        return true;
    PyErr_SetString(PyExc_ValueError, "expected as many rows in all columns of predicted boxes");
    close_arrays(5, columns);
    return false;
}

static void close_conflicts(Conflicts *now) {
    close_path(&now->path);
    close_arrays(6, (Array *[]){&now->corners, &now->begin, &now->end, &now->min_gap_m, &now->motion, &now->cells});
    free(now->own), free(now->rows);
    release_boxes(&now->set);
}

/* (path, vehicle, predicted, cells, margin); all have to be closed if it is true. */
static bool open_conflicts(PyObject *const *arguments, Conflicts *now) {
    *now = (Conflicts){0};
    if (!read_number_field(arguments[1], &SIZE, 0, &now->length) || !read_number_field(arguments[1], &SIZE, 1, &now->width) ||
        !read_number_field(arguments[4], &MARGIN, 0, &now->longitudinal) ||
        !read_number_field(arguments[4], &MARGIN, 1, &now->lateral) || !open_path(arguments[0], &now->path))
        return false;
    if (!open_predicted(arguments[2], now)) {
        close_path(&now->path);
        return false;
    }
    if (!open_array(arguments[3], 'l', &now->cells)) {
        close_path(&now->path);
        close_arrays(5, (Array *[]){&now->corners, &now->begin, &now->end, &now->min_gap_m, &now->motion});
        return false;
    }
    now->own = malloc((size_t)(now->cells.count + 1) * sizeof *now->own);
    now->rows = malloc((size_t)(now->cells.count + 1) * sizeof *now->rows);
    if (now->own && now->rows) return true;
    close_conflicts(now);
    PyErr_NoMemory();
    return false;
}

/* The own boxes in all cells, of another size than before. */
static bool measure_own(Conflicts *now, double length, double width) {
    release_boxes(&now->set);
    now->set = (BoxSet){0};
    return place_footprints(&now->path, integers(&now->cells), now->cells.count, length, width, now->own) &&
           measure_boxes(&now->set, now->own, now->cells.count);
}

static bool measure_within_margin(Conflicts *now) {
    return measure_own(now, now->length + 2 * now->longitudinal, now->width + 2 * now->lateral);
}

/* A mask of blocked cells: (TIMES * STRIDE, columns), each row of TIMES and each compared cell repeated; if `is_after`
   (columns), of boxes that stay after all times. */
typedef struct {
    bool is_after, *mask;
    Py_ssize_t stride, columns;
} Blocked;

static Py_ssize_t clip_row(const Array *rows, Py_ssize_t box, Py_ssize_t count) {
    Py_ssize_t row = (Py_ssize_t)integers(rows)[box];
    return row < 0 ? 0 : row < count ? row : count;
}

static void mark_cells(const Conflicts *now, Py_ssize_t box, Py_ssize_t found, const Blocked *blocked) {
    Py_ssize_t begin = 0, end = 1, columns = blocked->columns;
    if (!blocked->is_after) {
        begin = STRIDE * clip_row(&now->begin, box, TIMES), end = STRIDE * clip_row(&now->end, box, TIMES);
    }
    for (Py_ssize_t row = begin; row < end; row++)
        for (Py_ssize_t i = 0; i < found; i++) {
            Py_ssize_t low = now->rows[i] * blocked->stride, high = low + blocked->stride;
            for (Py_ssize_t cell = low; cell < high && cell < columns; cell++) blocked->mask[row * columns + cell] = true;
        }
}

static void mark_box(Conflicts *now, Py_ssize_t box, const Blocked *blocked) {
    if (blocked->is_after && integers(&now->end)[box] <= TIMES) return;
    const Box *theirs = boxes_of(&now->corners) + box;
    Circle circle = measure_box(theirs);
    mark_cells(now, box, find_overlapping(&now->set, theirs, &circle, now->rows), blocked);
}

/* Mark what boxes block within the margin, and then within larger gaps. */
static bool mark_blocked(Conflicts *now, const Blocked *blocked) {
    Py_ssize_t boxes = now->corners.shape[0];
    if (!boxes) return true;
    if (!measure_within_margin(now)) return false;
    for (Py_ssize_t box = 0; box < boxes; box++) mark_box(now, box, blocked);
    double measured_m = NAN;
    for (Py_ssize_t box = 0; box < boxes; box++) {
        double gap_m = doubles(&now->min_gap_m)[box];
        if (!(gap_m > now->longitudinal)) continue;
        if (gap_m != measured_m && !measure_own(now, now->length + 2 * gap_m, now->width)) return false;
        measured_m = gap_m;
        mark_box(now, box, blocked);
    }
    return true;
}

static PyObject *planning_motion_conflicts_find_blocked(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    Py_ssize_t stride;
    if (!expect_arguments("find_blocked", count, 6, 6) || !read_integer(arguments[5], &stride)) return NULL;
    Conflicts now;
    if (stride < 1) return PyErr_Format(PyExc_ValueError, "expected a stride of 1 or more, found %zd", stride);
    if (!open_conflicts(arguments, &now)) return NULL;
    Py_ssize_t columns = now.cells.count, compared = (columns + stride - 1) / stride;
    int64_t *every = malloc((size_t)(compared + 1) * sizeof *every);
    void *mask = NULL;
    PyObject *result = every ? new_array('?', 2, (Py_ssize_t[]){TIMES * STRIDE, columns}, &mask) : PyErr_NoMemory();
    if (result) {
        for (Py_ssize_t i = 0; i < compared; i++) every[i] = integers(&now.cells)[i * stride];
        now.cells.data = every, now.cells.count = compared;
        memset(mask, 0, (size_t)(TIMES * STRIDE * columns));
        if (!mark_blocked(&now, &(Blocked){false, mask, stride, columns})) Py_DecRef(result), result = NULL;
    }
    free(every);
    close_conflicts(&now);
    return result;
}

static PyObject *planning_motion_conflicts_find_blocked_after(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    Conflicts now;
    if (!expect_arguments("find_blocked_after", count, 5, 5) || !open_conflicts(arguments, &now)) return NULL;
    void *mask;
    PyObject *result = new_array('?', 1, &now.cells.count, &mask);
    if (result) {
        memset(mask, 0, (size_t)now.cells.count);
        if (!mark_blocked(&now, &(Blocked){true, mask, 1, now.cells.count})) Py_DecRef(result), result = NULL;
    }
    close_conflicts(&now);
    return result;
}

/* Whether the own box in cell k meets a box that is there at the k-th time, for all k of a box from `first` on: the
   first such k, or `end`. */
static Py_ssize_t find_next_meeting(const Conflicts *now, Py_ssize_t box, Py_ssize_t first, Py_ssize_t end) {
    const Box *theirs = boxes_of(&now->corners) + box;
    Circle circle = measure_box(theirs);
    for (Py_ssize_t k = first; k < end; k++)
        if (are_near(now->set.circles + k, &circle) && boxes_overlap(now->own + k, theirs)) return k;
    return end;
}

static PyObject *planning_motion_conflicts_find_met(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    Conflicts now;
    if (!expect_arguments("find_met", count, 5, 5) || !open_conflicts(arguments, &now)) return NULL;
    void *data = NULL;
    PyObject *result = measure_within_margin(&now) ? new_array('?', 1, &now.cells.count, &data) : NULL;
    bool *met = data;
    if (result) memset(met, 0, (size_t)now.cells.count);
    for (Py_ssize_t box = 0; result && box < now.corners.shape[0]; box++) {
        Py_ssize_t k = clip_row(&now.begin, box, now.cells.count), end = clip_row(&now.end, box, now.cells.count);
        while ((k = find_next_meeting(&now, box, k, end)) < end) met[k++] = true;
    }
    close_conflicts(&now);
    return result;
}

static PyObject *planning_motion_conflicts_find_first_met(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    Conflicts now;
    if (!expect_arguments("find_first_met", count, 5, 5) || !open_conflicts(arguments, &now)) return NULL;
    Py_ssize_t first = now.cells.count, motion = -1;
    PyObject *result = NULL;
    if (measure_within_margin(&now)) {
        for (Py_ssize_t box = 0; box < now.corners.shape[0]; box++) {
            Py_ssize_t end = clip_row(&now.end, box, first);
            Py_ssize_t k = find_next_meeting(&now, box, clip_row(&now.begin, box, end), end);
            if (k < end) first = k, motion = (Py_ssize_t)integers(&now.motion)[box];
        }
        result = motion < 0 ? new_reference(Py_None) : pack(2, PyLong_FromSsize_t(first), PyLong_FromSsize_t(motion));
    }
    close_conflicts(&now);
    return result;
}

Functions planning_motion_conflicts = {
    FUNCTION(planning_motion_conflicts_list_predicted_boxes),
    FUNCTION(planning_motion_conflicts_find_blocked),
    FUNCTION(planning_motion_conflicts_find_blocked_after),
    FUNCTION(planning_motion_conflicts_find_met),
    FUNCTION(planning_motion_conflicts_find_first_met),
    END_OF_FUNCTIONS,
};
