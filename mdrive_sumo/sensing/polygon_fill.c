/* Twin of polygon_fill.py: polygons as pixels. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "../core/compiled/values.h"

/* Marks of all layers and rows, each row with a place more than it has pixels, and whether a row has any. */
typedef struct {
    Py_ssize_t layers, size;
    signed char *marks;
    bool *has_marks;
} Canvas;

static double clip_up(double place, double size) {
    double above = ceil(place - 0.5);
    return above < 0.0 ? 0.0 : above > size ? size : above;
}

/* Leaves a mark at the first pixel to the right of an edge in every row that it crosses. */
static bool mark_edge(const double *edge, Py_ssize_t layer, Canvas *canvas) {
    double x0 = edge[0], y0 = edge[1], x1 = edge[2], y1 = edge[3], size = (double)canvas->size;
    double from = clip_up(y0, size), to = clip_up(y1, size);
    if (isnan(from) || isnan(to)) return false;
    Py_ssize_t top = (Py_ssize_t)(to < from ? to : from), bottom = (Py_ssize_t)(to < from ? from : to);
    double slope = bottom > top ? (x1 - x0) / (y1 - y0) : 0.0;
    for (Py_ssize_t row = top; row < bottom; row++) {
        double column = clip_up(x0 + ((double)row + 0.5 - y0) * slope, size);
        if (isnan(column)) return false;
        Py_ssize_t line = layer * canvas->size + row;
        canvas->marks[line * (canvas->size + 1) + (Py_ssize_t)column] += y1 > y0 ? 1 : -1;
        canvas->has_marks[line] = true;
    }
    return true;
}

/* Writes a row of pixels, and returns the winding number after it; most pixels lie between marks. */
static signed char fill_row(const signed char *marks, Py_ssize_t size, signed char winding, unsigned char *pixels) {
    Py_ssize_t i = 0;
    while (i < size) {
        uint64_t next = 0;
        if (i + 8 <= size) memcpy(&next, marks + i, sizeof next);
        else next = 1; /* one by one to the end */
        Py_ssize_t end = i + 8 < size ? i + 8 : size;
        if (!next) memset(pixels + i, winding ? 255 : 0, 8), i = end;
        for (; i < end; i++) {
            winding = (signed char)(winding + marks[i]);
            pixels[i] = winding ? 255 : 0;
        }
    }
    return (signed char)(winding + marks[size]);
}

static void fill_canvas(const Canvas *canvas, unsigned char *pixels) {
    signed char winding = 0; /* zero after every row if rings are closed */
    for (Py_ssize_t line = 0; line < canvas->layers * canvas->size; line++) {
        unsigned char *row = pixels + line * canvas->size;
        if (canvas->has_marks[line])
            winding = fill_row(canvas->marks + line * (canvas->size + 1), canvas->size, winding, row);
        else memset(row, winding ? 255 : 0, canvas->size);
    }
}

static bool mark_edges(const Array *edges, const Array *layers, Canvas *canvas) {
    const int64_t *layer = layers->data;
    bool is_valid = edges->count == 4 * layers->count;
    for (Py_ssize_t i = 0; is_valid && i < layers->count; i++)
        is_valid = layer[i] >= 0 && layer[i] < canvas->layers && mark_edge(doubles(edges) + 4 * i, layer[i], canvas);
    if (!is_valid) PyErr_SetString(PyExc_ValueError, "expected finite edges (E, 2, 2), and a layer for each");
    return is_valid;
}

static PyObject *fill(const Array *edges, const Array *layers, Canvas *canvas) {
    Py_ssize_t lines = canvas->layers * canvas->size, shape[] = {canvas->layers, canvas->size, canvas->size};
    canvas->marks = calloc(lines * (canvas->size + 1) + 1, 1);
    canvas->has_marks = calloc(lines + 1, sizeof *canvas->has_marks);
    PyObject *result = NULL;
    if (!canvas->marks || !canvas->has_marks) {
        PyErr_NoMemory();
    } else if (mark_edges(edges, layers, canvas)) {
        unsigned char *pixels;
        result = new_array('B', 3, shape, (void **)&pixels);
        if (result) fill_canvas(canvas, pixels);
    }
    free(canvas->marks);
    free(canvas->has_marks);
    return result;
}

static PyObject *sensing_polygon_fill_fill_polygons(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    enum { MOST = 1 << 15 }; /* more pixels along a side, or layers, than any image has */
    if (!expect_arguments("fill_polygons", count, 3, 3)) return NULL;
    PyObject *layer_count = PyTuple_GetItem(arguments[2], 0), *size = PyTuple_GetItem(arguments[2], 1);
    Canvas canvas;
    Array edges, layers;
    if (!layer_count || !size || !read_integer(layer_count, &canvas.layers) || !read_integer(size, &canvas.size))
        return NULL;
    if (canvas.layers < 0 || canvas.layers > MOST || canvas.size < 0 || canvas.size > MOST) {
        PyErr_SetString(PyExc_ValueError, "expected a number of layers and of pixels");
        return NULL;
    }
    if (!open_array(arguments[0], 'd', &edges)) return NULL;
    if (!open_array(arguments[1], 'l', &layers)) {
        close_array(&edges);
        return NULL;
    }
    PyObject *result = fill(&edges, &layers, &canvas);
    close_arrays(2, (Array *[]){&edges, &layers});
    return result;
}

Functions sensing_polygon_fill = {
    FUNCTION(sensing_polygon_fill_fill_polygons),
    END_OF_FUNCTIONS,
};
