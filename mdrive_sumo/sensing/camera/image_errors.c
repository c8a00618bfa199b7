/* Twin of image_errors.py: vignetting and noise of an image. */
#include "../../core/compiled/values.h"

enum { DRAW_ZERO = 128 };

static void spoil_row(const unsigned char *restrict from, const unsigned char *restrict gain,
                      const unsigned char *restrict draws, Py_ssize_t values, unsigned char *restrict to) {
    for (Py_ssize_t i = 0; i < values; i++) {
        short lit = (short)(unsigned char)((unsigned short)(from[i] * (gain[i] + 1)) >> 8);
        short value = (short)(lit + draws[i] - DRAW_ZERO);
        value = value < 0 ? 0 : value;
        to[i] = (unsigned char)(value > 255 ? 255 : value);
    }
}

static bool check(const Array *image, const Array *gain, const Array *draws, const Array *starts) {
    bool has_shape = image->dimensions == 3 && gain->dimensions == 3 && starts->dimensions == 1 &&
                     starts->count == image->shape[0];
    for (int i = 0; has_shape && i < 3; i++) has_shape = gain->shape[i] == image->shape[i];
    if (!has_shape) {
        PyErr_SetString(PyExc_ValueError,
                        "expected an image (H, W, 3), a gain for each value and a start for each row");
        return false;
    }
    const int64_t *start = starts->data;
    bool is_valid = true;
    for (Py_ssize_t i = 0; is_valid && i < starts->count; i++)
        is_valid = start[i] >= 0 && start[i] <= draws->count - image->shape[1] * image->shape[2];
    if (!is_valid) PyErr_SetString(PyExc_ValueError, "expected starts that there are draws for");
    return is_valid;
}

static PyObject *sensing_camera_image_errors_add_errors(PyObject *module, PyObject *const *arguments,
                                                        Py_ssize_t count) {
    static const char KINDS[] = "BBBl";
    Array arrays[4];
    int opened = 0;
    if (!expect_arguments("add_errors", count, 4, 4)) return NULL;
    while (opened < 4 && open_array(arguments[opened], KINDS[opened], arrays + opened)) opened++;
    PyObject *result = NULL;
    if (opened == 4 && check(arrays, arrays + 1, arrays + 2, arrays + 3)) {
        Py_ssize_t rows = arrays[0].shape[0], values = arrays[0].shape[1] * arrays[0].shape[2];
        unsigned char *pixels;
        result = new_array('B', 3, arrays[0].shape, (void **)&pixels);
        const unsigned char *from = arrays[0].data, *gain = arrays[1].data, *draws = arrays[2].data;
        const int64_t *starts = arrays[3].data;
        for (Py_ssize_t row = 0; result && row < rows; row++)
            spoil_row(from + row * values, gain + row * values, draws + starts[row], values, pixels + row * values);
    }
    for (int i = 0; i < opened; i++) close_array(arrays + i);
    return result;
}

Functions sensing_camera_image_errors = {
    FUNCTION(sensing_camera_image_errors_add_errors),
    END_OF_FUNCTIONS,
};
