/* What other C files need of reference_path.py. */
#ifndef MDRIVE_REFERENCE_PATH_H
#define MDRIVE_REFERENCE_PATH_H

#define SPACING_M 0.25

#endif
