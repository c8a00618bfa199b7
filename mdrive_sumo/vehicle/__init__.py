"""The body of a CAV: dynamics, contact between boxes, controllers that turn a plan into pedals and steering."""
