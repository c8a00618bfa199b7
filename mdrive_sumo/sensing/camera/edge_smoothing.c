/* Twin of edge_smoothing.py: antialiasing of a drawn image. */
#include <stdlib.h>
#include <string.h>

#include "../../core/compiled/values.h"

enum { LEAST_JUMP = 21, SEARCH_PX = 6 };

typedef struct {
    Py_ssize_t height, width;
    const unsigned char *pixels; /* (H, W, 4) */
    unsigned char *bright;       /* (H, W) */
    unsigned char *smooth;       /* (H, W, 3) */
} Canvas;

typedef struct {
    int distance, end;
} Way;

/* Two loops over four bytes at once: a processor computes many of the first, and the second only moves. */
static void copy_pixels(const Canvas *canvas) {
    Py_ssize_t count = canvas->height * canvas->width;
    const unsigned char *restrict from = canvas->pixels;
    unsigned char *restrict to = canvas->smooth, *restrict bright = canvas->bright;
    for (Py_ssize_t i = 0; i < count; i++) {
        uint32_t pixel; /* red is the lowest byte: all targets are little-endian */
        memcpy(&pixel, from + 4 * i, sizeof pixel);
        uint32_t red = pixel & 255, green = pixel >> 8 & 255, blue = pixel >> 16 & 255;
        bright[i] = (unsigned char)((2 * red + 5 * green + blue) >> 3);
    }
    for (Py_ssize_t i = 0; i + 1 < count; i++) memcpy(to + 3 * i, from + 4 * i, 4); /* the next one covers the fourth */
    if (count) memcpy(to + 3 * (count - 1), from + 4 * (count - 1), 3);
}

/* As _follow. */
static Way follow(const unsigned char *at, Py_ssize_t along, Py_ssize_t step, int middle, int jump, Py_ssize_t room) {
    Way way = {1, 0};
    for (at += along;; at += along) {
        way.end = at[0] + at[step] - middle;
        if (way.distance == SEARCH_PX || 2 * abs(way.end) >= jump || way.distance >= room) return way;
        way.distance++;
    }
}

static bool is_along_row(const unsigned char *at, Py_ssize_t width) {
    const unsigned char *up = at - width, *down = at + width;
    int across_rows = abs(up[-1] + down[-1] - 2 * at[-1]) + 2 * abs(*up + *down - 2 * *at) +
                      abs(up[1] + down[1] - 2 * at[1]);
    int across_columns = abs(up[-1] + up[1] - 2 * *up) + 2 * abs(at[-1] + at[1] - 2 * *at) +
                         abs(down[-1] + down[1] - 2 * *down);
    return across_rows >= across_columns;
}

/* As _mix, of one pixel. */
static void mix(const Canvas *canvas, Py_ssize_t row, Py_ssize_t column) {
    Py_ssize_t width = canvas->width, i = row * width + column;
    const unsigned char *at = canvas->bright + i;
    bool is_level = is_along_row(at, width);
    Py_ssize_t across = is_level ? width : 1, along = is_level ? 1 : width;
    Py_ssize_t step = abs(at[-across] - *at) >= abs(at[across] - *at) ? -across : across;
    int middle = *at + at[step], jump = abs(at[step] - *at);
    Way back = follow(at, -along, step, middle, jump, is_level ? column : row);
    Way on = follow(at, along, step, middle, jump, is_level ? width - 1 - column : canvas->height - 1 - row);
    bool is_back = back.distance < on.distance;
    int near = is_back ? back.distance : on.distance, end = is_back ? back.end : on.end;
    if ((end < 0) == (2 * *at - middle < 0) || 2 * abs(end) < jump) return;
    int share = 128 - 256 * near / (back.distance + on.distance);
    const unsigned char *own = canvas->pixels + 4 * i, *other = canvas->pixels + 4 * (i + step);
    for (int k = 0; k < 3; k++)
        canvas->smooth[3 * i + k] = (unsigned char)((own[k] * (256 - share) + other[k] * share + 128) >> 8);
}

static inline unsigned char least(unsigned char a, unsigned char b) { return a < b ? a : b; }
static inline unsigned char most(unsigned char a, unsigned char b) { return a > b ? a : b; }

/* Whether pixels lie at an edge: without a branch, for processors that compare many bytes at once. */
static void find_edges(const unsigned char *restrict at, Py_ssize_t width, Py_ssize_t count,
                       unsigned char *restrict edges) {
    for (Py_ssize_t i = 0; i < count; i++) {
        const unsigned char *here = at + i;
        unsigned char low = least(least(least(here[0], here[-width]), least(here[width], here[-1])), here[1]);
        unsigned char high = most(most(most(here[0], here[-width]), most(here[width], here[-1])), here[1]);
        unsigned char needed = most(LEAST_JUMP, (unsigned char)((high >> 3) + (high >> 5)));
        edges[i] = (unsigned char)(high - low) >= needed ? 255 : 0;
    }
}

static void smooth(const Canvas *canvas, unsigned char *edges) {
    copy_pixels(canvas);
    Py_ssize_t inner = canvas->width - 2;
    for (Py_ssize_t row = 1; row < canvas->height - 1; row++) {
        find_edges(canvas->bright + row * canvas->width + 1, canvas->width, inner, edges);
        for (Py_ssize_t i = 0; i < inner; i++) {
            uint64_t eight;
            if (i + 8 <= inner && (memcpy(&eight, edges + i, sizeof eight), !eight)) i += 7;
            else if (edges[i]) mix(canvas, row, i + 1);
        }
    }
}

static PyObject *sensing_camera_edge_smoothing_smooth_edges(PyObject *module, PyObject *const *arguments,
                                                            Py_ssize_t count) {
    Array image;
    if (!expect_arguments("smooth_edges", count, 1, 1) || !open_array(arguments[0], 'B', &image)) return NULL;
    PyObject *result = NULL;
    if (image.dimensions != 3 || image.shape[2] != 4) {
        PyErr_SetString(PyExc_ValueError, "expected an image (H, W, 4)");
    } else {
        Canvas canvas = {image.shape[0], image.shape[1], image.data, NULL, NULL};
        Py_ssize_t shape[] = {canvas.height, canvas.width, 3};
        canvas.bright = malloc(canvas.height * canvas.width + canvas.width + 1);
        result = canvas.bright ? new_array('B', 3, shape, (void **)&canvas.smooth) : PyErr_NoMemory();
        if (result) smooth(&canvas, canvas.bright + canvas.height * canvas.width);
        free(canvas.bright);
    }
    close_array(&image);
    return result;
}

Functions sensing_camera_edge_smoothing = {
    FUNCTION(sensing_camera_edge_smoothing_smooth_edges),
    END_OF_FUNCTIONS,
};
