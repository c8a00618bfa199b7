/* The extension module: all functions of all twins. */
#include <stdlib.h>
#include <string.h>

#include "values.h"

/* A line for each C file beside a Python file, in the order of rooms. */
#define FILES(USE) USE(actors_collision_avoidance) USE(actors_movers) USE(agents_learned_point_grid) USE(contract_reply_check) USE(core_frozen) \
    USE(core_geometry) USE(core_portable) USE(core_seeding) USE(core_state) USE(episode_quantization) \
    USE(negotiation_announcement) USE(negotiation_conflict_graph) USE(negotiation_intention) \
    USE(negotiation_rule_negotiator) USE(perception_assignment) USE(perception_measurements) \
    USE(perception_static_object_tracker) USE(perception_track_list) USE(perception_track_states) \
    USE(planning_car_following) USE(planning_detour) USE(planning_fleet_paths) USE(planning_free_drive) \
    USE(planning_interaction_prediction) USE(planning_motion_conflicts) USE(planning_moving_traffic) \
    USE(planning_obstacle_avoidance) USE(planning_path_follower) USE(planning_path_overlap) \
    USE(planning_pedestrian_caution) USE(planning_profile_search) USE(planning_reference_path) \
    USE(planning_right_of_way) USE(planning_road_direction) USE(planning_speed_profile) USE(real2sim_quality_actor_quality) \
    USE(real2sim_tracks_bounded_trajectory) \
    USE(roads_lane_search) \
    USE(scoring_criteria) USE(scoring_metrics_collisions) USE(scoring_metrics_min_pet) USE(scoring_metrics_min_ttc) \
    USE(sensing_lidar_cast) USE(sensing_lidar_sensor) USE(sensing_link_classes) USE(sensing_localization) USE(sensing_objects_sensor) \
    USE(sensing_polygon_fill) USE(sensing_visibility) USE(sumo_conflict) USE(sumo_ghost_placement) \
    USE(sumo_sumo_frames) USE(v2x_awareness_service) USE(v2x_channel) USE(v2x_encoding) USE(v2x_mcm_encoding) \
    USE(v2x_radio_channel_load) USE(v2x_radio_radio_medium) USE(v2x_radio_received_power) \
    USE(vehicle_contact) USE(vehicle_control_plan_reader) USE(vehicle_control_tracker) USE(vehicle_dynamics) \
    USE(vehicle_impact)

#define DECLARE(file) extern Functions file;
#define LIST(file) file,
FILES(DECLARE)
static PyMethodDef *const TABLES[] = {FILES(LIST)};
enum { COUNT = sizeof TABLES / sizeof *TABLES };

static PyModuleDef DEFINITION = {{1, 0}, 0, 0, 0, "mdrive_sumo.core.compiled.layer", 0, -1, 0, 0, 0, 0, 0};

__attribute__((visibility("default"))) PyObject *PyInit_layer(void) {
    size_t functions = 1;
    for (int i = 0; i < COUNT; i++)
        for (PyMethodDef *row = TABLES[i]; row->ml_name; row++) functions++;
    PyMethodDef *all = calloc(functions, sizeof *all); /* kept as long as the module */
    if (!all) return PyErr_NoMemory();
    PyMethodDef *next = all;
    for (int i = 0; i < COUNT; i++)
        for (PyMethodDef *row = TABLES[i]; row->ml_name; row++) *next++ = *row;
    DEFINITION.m_methods = all;
    PyObject *module = PyModule_Create2(&DEFINITION, PYTHON_API_VERSION);
    if (module && (PyModule_AddStringConstant(module, "VERSION", MDRIVE_VERSION) ||
                   PyModule_AddStringConstant(module, "FILES", MDRIVE_FILES) ||
                   PyModule_AddStringConstant(module, "SOURCES", MDRIVE_SOURCES))) {
        Py_DecRef(module);
        return NULL;
    }
    return module;
}
