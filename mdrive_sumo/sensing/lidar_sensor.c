/* Twin of lidar_sensor.py: the points of a scan. */
#include <math.h>
#include <string.h>

#include "../core/compiled/values.h"
#include "../core/portable.h"

static const int64_t NOTHING = 0xFFFFFFFF;
static const float ATTENUATION = 0.004f;
FIELDS(RAYS, "stretch", "local");

typedef struct {
    Array stretch, local, keys, kept, noise_m, reflectivity;
} Input;

static bool open_input(PyObject *const *arguments, Input *input) {
    static const char kinds[] = "ffl?ff";
    Array *arrays[] = {&input->stretch, &input->local, &input->keys, &input->kept, &input->noise_m,
                       &input->reflectivity};
    for (int i = 0; i < 6; i++) {
        PyObject *array = i < 2 ? get_field(arguments[0], &RAYS, i) : new_reference(arguments[i - 1]);
        bool is_open = array && open_array(array, kinds[i], arrays[i]);
        if (array) Py_DecRef(array);
        if (!is_open) {
            close_arrays(i, arrays);
            return false;
        }
    }
    return true;
}

static void close_input(Input *input) {
    close_arrays(6, (Array *[]){&input->stretch, &input->local, &input->keys, &input->kept, &input->noise_m,
                                &input->reflectivity});
}

static int64_t get_owner(const Input *input, Py_ssize_t ray) { return ((const int64_t *)input->keys.data)[ray] & NOTHING; }

static bool is_hit(const Input *input, Py_ssize_t ray) {
    return get_owner(input, ray) != NOTHING && (!input->kept.count || ((const unsigned char *)input->kept.data)[ray]);
}

/* Counts the points; -1: arrays do not fit, with Python's error set. */
static Py_ssize_t count_points(const Input *input) {
    Py_ssize_t rays = input->keys.count, count = 0;
    bool is_valid = input->stretch.count == rays && input->local.count == 3 * rays &&
                    (!input->kept.count || input->kept.count == rays) &&
                    (!input->noise_m.count || input->noise_m.count == rays);
    for (Py_ssize_t i = 0; is_valid && i < rays; i++) {
        if (!is_hit(input, i)) continue;
        is_valid = get_owner(input, i) < input->reflectivity.count;
        count++;
    }
    if (is_valid) return count;
    PyErr_SetString(PyExc_ValueError, "expected arrays with one row for each ray, and a reflectivity for each owner");
    return -1;
}

static bool fill_points(const Input *input, float *points, int64_t *owners) {
    const float *stretch = input->stretch.data, *local = input->local.data, *noise_m = input->noise_m.data;
    const float *reflectivity = input->reflectivity.data;
    bool is_finite = true;
    for (Py_ssize_t i = 0; i < input->keys.count; i++) {
        if (!is_hit(input, i)) continue;
        int32_t bits = (int32_t)(((const int64_t *)input->keys.data)[i] >> 32);
        float distance;
        memcpy(&distance, &bits, sizeof distance);
        distance *= stretch[i];
        if (input->noise_m.count) {
            distance += noise_m[i];
            if (distance < 0.0f) distance = 0.0f;
        }
        for (int k = 0; k < 3; k++) points[k] = local[3 * i + k] * distance;
        double rest = portable_exp(-ATTENUATION * distance);
        is_finite = is_finite && isfinite(rest);
        *owners = get_owner(input, i);
        points[3] = (float)((double)reflectivity[*owners] * rest);
        points += 4, owners++;
    }
    if (!is_finite) PyErr_SetString(PyExc_ValueError, "expected finite distances");
    return is_finite;
}

static PyObject *sensing_lidar_sensor_build_points(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    Input input;
    if (!expect_arguments("build_points", count, 5, 5) || !open_input(arguments, &input)) return NULL;
    Py_ssize_t shape[] = {count_points(&input), 4};
    float *points;
    int64_t *owners;
    PyObject *cloud = shape[0] < 0 ? NULL : new_array('f', 2, shape, (void **)&points);
    PyObject *owner = cloud ? new_array('l', 1, shape, (void **)&owners) : NULL;
    bool is_filled = owner && fill_points(&input, points, owners);
    close_input(&input);
    if (is_filled) return pack(2, cloud, owner);
    if (cloud) Py_DecRef(cloud);
    if (owner) Py_DecRef(owner);
    return NULL;
}

Functions sensing_lidar_sensor = {
    FUNCTION(sensing_lidar_sensor_build_points),
    END_OF_FUNCTIONS,
};
