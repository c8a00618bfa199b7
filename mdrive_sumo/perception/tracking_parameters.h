/* The parameters of tracking_parameters.py. */
#ifndef MDRIVE_TRACKING_PARAMETERS_H
#define MDRIVE_TRACKING_PARAMETERS_H

#include "../core/compiled/values.h"

typedef struct {
    double acceleration_sigma, turn_acceleration_sigma, max_turn_rate, gate, known_name_gate, known_name_bonus,
        min_gate_widths, correlation_ticks, confirmation_ticks, moving_speed, lead_m, lead_lateral_m, lead_yaw,
        coasting_ticks, standing_coasting_ticks, tentative_ticks, standstill_ticks, standstill_count, standstill_sigmas,
        standstill_m, standstill_speed_sigmas, standstill_speeds, own_radius_m, never_ticks,
        position_floor, yaw_floor, speed_floor,
        size_weight;
} TrackingParameters;
bool read_tracking_parameters(PyObject *object, TrackingParameters *parameters);
#endif
