/* Contact of one pair of bodies for other C files: the twins of impact.py. */
#ifndef MDRIVE_IMPACT_H
#define MDRIVE_IMPACT_H

#include "../core/geometry.h"

typedef struct {
    double x, y, yaw;
} Pose;
/* As RigidBody; points and body are one piece of memory, for `free`. */
typedef struct {
    Py_ssize_t corners, normals;
    Point *start, *end, *normal;
    Point centre, velocity;
    double yaw_rate, inverse_mass, inverse_inertia;
    bool is_changed; /* by a collision */
} RigidBody;

/* NULL with Python's error set where there is no memory or a number cannot be used. */
RigidBody *build_static_body(const Point *piece, Py_ssize_t count);
RigidBody *build_box_body(Pose before, Pose after, double length, double width);

typedef struct {
    bool is_there;
    Point normal;
    double depth;
} ContactManifold;
ContactManifold find_contact(const RigidBody *first, const RigidBody *second);
void resolve_collision(RigidBody *first, RigidBody *second, const ContactManifold *meeting, bool *is_refused);

#endif
