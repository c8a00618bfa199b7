/* Twin of lane_search.py. */
#include <math.h>
#include <stdlib.h>

#include "../core/compiled/values.h"
#include "../core/geometry.h"

/* A row of LineSegments. */
typedef struct {
    double begin, x0, y0, x1, y1, length;
} Row;
typedef struct {
    double low_x, low_y, high_x, high_y;
} Bounds;
typedef struct {
    const Row *rows;
    const int64_t *first;
    Py_ssize_t line_count;
    Bounds *bounds; /* of each line */
} Lines;
typedef struct {
    Py_ssize_t line, row;
    double distance, share;
} Place;

static const double SLACK = 1.0 + 1e-9, SLACK_M = 1e-6; /* a box so little beyond the least distance is looked into */

static Bounds compute_bounds(const Row *row, const Row *end) {
    Bounds bounds = {INFINITY, INFINITY, -INFINITY, -INFINITY};
    for (; row < end; row++) {
        bounds.low_x = least(bounds.low_x, least(row->x0, row->x1));
        bounds.low_y = least(bounds.low_y, least(row->y0, row->y1));
        bounds.high_x = greatest(bounds.high_x, greatest(row->x0, row->x1));
        bounds.high_y = greatest(bounds.high_y, greatest(row->y0, row->y1));
    }
    return bounds;
}

static bool is_beyond(const Bounds *bounds, Point at, double distance) {
    double x = greatest(greatest(bounds->low_x - at.x, at.x - bounds->high_x), 0.0);
    double y = greatest(greatest(bounds->low_y - at.y, at.y - bounds->high_y), 0.0);
    double reach = distance * SLACK + SLACK_M;
    return x * x + y * y > reach * reach;
}

/* Improves on the nearest place if a segment of the line is nearer: the first of equally near ones. */
static void look_at_line(const Lines *lines, Py_ssize_t line, Point at, Place *nearest) {
    for (Py_ssize_t i = lines->first[line]; i < lines->first[line + 1]; i++) {
        Row on = lines->rows[i];
        double dx = on.x1 - on.x0, dy = on.y1 - on.y0, square = greatest(dx * dx + dy * dy, 1e-300);
        double share = ((at.x - on.x0) * dx + (at.y - on.y0) * dy) / square, distance;
        if (share <= 0.0) distance = portable_hypot(at.x - on.x0, at.y - on.y0);
        else if (share >= 1.0) distance = portable_hypot(at.x - on.x1, at.y - on.y1);
        else distance = fabs((on.y0 - at.y) * dx - (on.x0 - at.x) * dy) / square * sqrt(square);
        bool is_nearer = distance < nearest->distance || (distance == nearest->distance && line < nearest->line);
        if (is_nearer) *nearest = (Place){line, i, distance, share};
    }
}

static Place find_nearest(const Lines *lines, Point at, Py_ssize_t likely) {
    Place nearest = {lines->line_count, 0, INFINITY, 0.0};
    look_at_line(lines, likely, at, &nearest);
    for (Py_ssize_t line = 0; line < lines->line_count; line++)
        if (line != likely && !is_beyond(lines->bounds + line, at, nearest.distance)) look_at_line(lines, line, at, &nearest);
    return nearest;
}

static Py_ssize_t find_row(const Lines *lines, const Place *nearest) {
    Row on = lines->rows[nearest->row];
    double share = nearest->share < 0.0 ? 0.0 : nearest->share > 1.0 ? 1.0 : nearest->share;
    double station = on.begin + share * on.length;
    Py_ssize_t low = lines->first[nearest->line], high = lines->first[nearest->line + 1];
    while (low < high) {
        Py_ssize_t middle = (low + high) / 2;
        if (station < lines->rows[middle].begin) high = middle;
        else low = middle + 1;
    }
    return low - 1;
}

static PyObject *find_places(const Lines *lines, const Array *xy) {
    int64_t *line, *row;
    double *distance;
    const Py_ssize_t shape[] = {xy->shape[0]};
    PyObject *first = new_array('l', 1, shape, (void **)&line);
    PyObject *second = first ? new_doubles(1, shape, &distance) : NULL;
    PyObject *third = second ? new_array('l', 1, shape, (void **)&row) : NULL;
    Py_ssize_t likely = 0;
    for (Py_ssize_t i = 0; third && i < xy->shape[0]; i++) {
        Place nearest = find_nearest(lines, ((const Point *)xy->data)[i], likely);
        if (!(nearest.distance < INFINITY)) {
            Py_DecRef(third);
            third = refuse_numbers("find_nearest_lines");
            break;
        }
        line[i] = likely = nearest.line, distance[i] = nearest.distance, row[i] = find_row(lines, &nearest);
    }
    if (third) return pack(3, first, second, third);
    if (first) Py_DecRef(first);
    if (second) Py_DecRef(second);
    return NULL;
}

static bool are_lines(const Array *rows, const Array *first) {
    const int64_t *begin = first->data;
    bool are = rows->shape[1] == sizeof(Row) / sizeof(double) && first->count >= 2 && begin[0] == 0 &&
               begin[first->count - 1] == rows->shape[0];
    for (Py_ssize_t i = 1; are && i < first->count; i++) are = begin[i] > begin[i - 1];
    if (!are) PyErr_SetString(PyExc_ValueError, "expected the segments of one line or more");
    return are;
}

static bool are_points(const Array *xy) {
    bool are = xy->shape[1] == 2;
    for (Py_ssize_t i = 0; are && i < xy->count; i++) are = isfinite(doubles(xy)[i]);
    if (!are) PyErr_SetString(PyExc_ValueError, "expected finite points (M, 2)");
    return are;
}

static PyObject *roads_lane_search_find_nearest_lines(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    Array rows, first, xy;
    if (!expect_arguments("find_nearest_lines", count, 3, 3) || !open_doubles(arguments[0], 2, &rows)) return NULL;
    PyObject *result = NULL;
    if (open_array(arguments[1], 'l', &first)) {
        if (open_doubles(arguments[2], 2, &xy)) {
            if (are_lines(&rows, &first) && are_points(&xy)) {
                Lines lines = {rows.data, first.data, first.count - 1, malloc(first.count * sizeof(Bounds))};
                for (Py_ssize_t i = 0; lines.bounds && i < lines.line_count; i++)
                    lines.bounds[i] = compute_bounds(lines.rows + lines.first[i], lines.rows + lines.first[i + 1]);
                result = lines.bounds ? find_places(&lines, &xy) : PyErr_NoMemory();
                free(lines.bounds);
            }
            close_array(&xy);
        }
        close_array(&first);
    }
    close_array(&rows);
    return result;
}

Functions roads_lane_search = {
    FUNCTION(roads_lane_search_find_nearest_lines),
    END_OF_FUNCTIONS,
};
