/* Twin of lidar_returns.py: the points of a scan. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "../core/compiled/values.h"
#include "../core/portable.h"

static const int64_t NOTHING = 0xFFFFFF, ROOF = 127, MIDDLE = 128;
static const double FACE_STEPS = 126.0, GRAZING = 0.42, PLATE_LOW_M = 0.45, PLATE_HIGH_M = 0.57;
static const double NEAREST_DROP_M = 1.0, FARTHER = 0.9, LEVELS = 255.0, SPREAD = 147.80;
FIELDS(RAYS, "slope", "stretch", "local");
FIELDS(REFLECTS, "lower", "upper", "split", "plate");
FIELDS(OPTICS, "attenuation", "weak", "noise", "drops");

enum { SLOPE, STRETCH, LOCAL, KEYS, GROUND, LOWER, UPPER, SPLIT, PLATE, KEPT, NOISE_M, ARRAYS };
enum { MOST_RAYS = 1 << 23 };
static const char KINDS[] = "dffldffff?f";

typedef struct {
    Array arrays[ARRAYS];
    double attenuation, weak, noise, drops, height;
    uint64_t luck;
} Input;

static const float *floats(const Input *input, int i) { return input->arrays[i].data; }

static PyObject *find_array(PyObject *const *arguments, int i) {
    if (i < KEYS) return get_field(arguments[0], &RAYS, i);
    if (i >= LOWER && i <= PLATE) return get_field(arguments[3], &REFLECTS, i - LOWER);
    return new_reference(arguments[i == KEYS ? 1 : i == GROUND ? 2 : i == KEPT ? 7 : 8]);
}

static void close_input(Input *input, int count) {
    for (int i = 0; i < count; i++) close_array(input->arrays + i);
}

static bool check_input(const Input *input) {
    const Array *arrays = input->arrays;
    Py_ssize_t rays = arrays[KEYS].count;
    bool is_valid = rays < MOST_RAYS && arrays[SLOPE].count == rays && arrays[STRETCH].count == rays &&
                    arrays[LOCAL].count == 3 * rays && arrays[GROUND].count == rays &&
                    (!arrays[KEPT].count || arrays[KEPT].count == rays) &&
                    (!arrays[NOISE_M].count || arrays[NOISE_M].count == rays);
    for (int i = UPPER; i <= PLATE; i++) is_valid = is_valid && arrays[i].count == arrays[LOWER].count;
    const int64_t *keys = arrays[KEYS].data;
    for (Py_ssize_t i = 0; is_valid && i < rays; i++) {
        int64_t owner = keys[i] >> 8 & NOTHING;
        is_valid = owner == NOTHING || owner < arrays[LOWER].count;
    }
    if (is_valid) return true;
    PyErr_SetString(PyExc_ValueError, "expected arrays with one row for each ray, and a reflectivity for each owner");
    return false;
}

static bool open_input(PyObject *const *arguments, Input *input) {
    Py_ssize_t luck;
    double optics[4];
    if (!read_fields(arguments[4], &OPTICS, optics) || !read_number(arguments[5], &input->height) ||
        !read_integer(arguments[6], &luck))
        return false;
    input->attenuation = optics[0], input->weak = optics[1], input->noise = optics[2], input->drops = optics[3];
    input->luck = (uint64_t)luck;
    for (int i = 0; i < ARRAYS; i++) {
        PyObject *array = find_array(arguments, i);
        bool is_open = array && open_array(array, KINDS[i], input->arrays + i);
        if (array) Py_DecRef(array);
        if (!is_open) {
            close_input(input, i);
            return false;
        }
    }
    if (check_input(input)) return true;
    close_input(input, ARRAYS);
    return false;
}

/* As draw_bits, of one ray. */
static uint64_t draw_bits(uint64_t luck, Py_ssize_t ray) {
    uint64_t state = luck + ((uint64_t)ray + 1) * 0x9E3779B97F4A7C15u;
    state = (state ^ state >> 30) * 0xBF58476D1CE4E5B9u;
    state = (state ^ state >> 27) * 0x94D049BB133111EBu;
    return state ^ state >> 31;
}

/* A ray that gives a point, in few bytes: large blocks of memory cost more than what is computed of them. */
typedef struct {
    uint32_t ray : 23, is_drop : 1, level : 8;
} Return;

static float get_across(const Input *input, Py_ssize_t ray) {
    int32_t bits = (int32_t)(((const int64_t *)input->arrays[KEYS].data)[ray] >> 32);
    float across;
    memcpy(&across, &bits, sizeof across);
    return across;
}

static double find_drop(uint64_t bits) { return NEAREST_DROP_M / (1.0 - FARTHER * ((double)(bits >> 40) * 0x1p-24)); }

static double compute_strength(const Input *input, Py_ssize_t ray, int64_t owner, int64_t face, double distance) {
    if (!owner) return doubles(input->arrays + GROUND)[ray];
    double level = face == ROOF ? fabs(doubles(input->arrays + SLOPE)[ray]) : (double)face / FACE_STEPS;
    double cosine = level / floats(input, STRETCH)[ray];
    return (cosine + GRAZING * (1.0 - cosine * cosine)) * portable_exp(-input->attenuation * distance);
}

static double find_reflectivity(const Input *input, int64_t owner, int64_t face, double z) {
    float plate = floats(input, PLATE)[owner];
    if (face > MIDDLE && plate > 0.0f && z >= PLATE_LOW_M && z < PLATE_HIGH_M) return plate;
    bool is_low = face % MIDDLE == ROOF || z < floats(input, SPLIT)[owner];
    return floats(input, is_low ? LOWER : UPPER)[owner];
}

/* Whether the ray gives a point. */
static bool sense_return(const Input *input, Py_ssize_t ray, Return *found) {
    int64_t key = ((const int64_t *)input->arrays[KEYS].data)[ray], owner = key >> 8 & NOTHING, face = key & 0xFF;
    if (owner == NOTHING && !input->drops) return false;
    float across = get_across(input, ray), distance = across * floats(input, STRETCH)[ray];
    uint64_t bits = draw_bits(input->luck, ray);
    if ((double)(bits >> 32 & 255) < input->drops && find_drop(bits) < distance) {
        *found = (Return){(uint32_t)ray, true, 1 + (bits & 7)};
        return true;
    }
    if (owner == NOTHING) return false;
    double far = distance, loss = input->weak * (far * far), chance = (double)(bits >> 40) * 0x1p-24;
    double strength = compute_strength(input, ray, owner, face % MIDDLE, far);
    double z = input->height + doubles(input->arrays + SLOPE)[ray] * across;
    double light = find_reflectivity(input, owner, face, z) * strength;
    if (!(chance * (light + loss) >= loss)) return false;
    int sum_of_bytes = (int)((bits & 255) + (bits >> 8 & 255) + (bits >> 16 & 255) + (bits >> 24 & 255));
    double factor = 1.0 + input->noise * ((sum_of_bytes - 510.0) / SPREAD), level = LEVELS * (light * factor) + 0.5;
    *found = (Return){(uint32_t)ray, false, !(level < LEVELS) ? (uint32_t)LEVELS : level > 0.0 ? (uint32_t)level : 0};
    return true;
}

static void fill_points(const Input *input, const Return *returns, Py_ssize_t count, float *points, int64_t *owners) {
    for (Py_ssize_t i = 0; i < count; i++, points += 4) {
        Py_ssize_t ray = returns[i].ray;
        const float *local = floats(input, LOCAL) + 3 * ray;
        bool is_drop = returns[i].is_drop;
        float distance = is_drop ? (float)find_drop(draw_bits(input->luck, ray))
                                 : get_across(input, ray) * floats(input, STRETCH)[ray];
        if (input->arrays[NOISE_M].count) {
            distance += floats(input, NOISE_M)[ray];
            if (distance < 0.0f) distance = 0.0f;
        }
        for (int k = 0; k < 3; k++) points[k] = local[k] * distance;
        points[3] = (float)(returns[i].level / LEVELS);
        owners[i] = is_drop ? 0 : ((const int64_t *)input->arrays[KEYS].data)[ray] >> 8 & NOTHING;
    }
}

static PyObject *build_cloud(const Input *input, Return *returns) {
    const unsigned char *kept = input->arrays[KEPT].count ? input->arrays[KEPT].data : NULL;
    Py_ssize_t count = 0;
    for (Py_ssize_t i = 0; i < input->arrays[KEYS].count; i++)
        if ((!kept || kept[i]) && sense_return(input, i, returns + count)) count++;
    Py_ssize_t shape[] = {count, 4};
    float *points;
    int64_t *owners;
    PyObject *cloud = new_array('f', 2, shape, (void **)&points);
    PyObject *owner = cloud ? new_array('l', 1, shape, (void **)&owners) : NULL;
    if (owner) fill_points(input, returns, count, points, owners);
    else if (cloud) Py_DecRef(cloud);
    return owner ? pack(2, cloud, owner) : NULL;
}

static PyObject *sensing_lidar_returns_build_points(PyObject *module, PyObject *const *arguments, Py_ssize_t count) {
    Input input;
    if (!expect_arguments("build_points", count, 9, 9) || !open_input(arguments, &input)) return NULL;
    Return *returns = malloc((input.arrays[KEYS].count + 1) * sizeof *returns);
    PyObject *result = returns ? build_cloud(&input, returns) : PyErr_NoMemory();
    free(returns);
    close_input(&input, ARRAYS);
    return result;
}

Functions sensing_lidar_returns = {
    FUNCTION(sensing_lidar_returns_build_points),
    END_OF_FUNCTIONS,
};
