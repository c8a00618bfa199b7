// Calibration of a gamepad or wheel, step by step, in the settings.
