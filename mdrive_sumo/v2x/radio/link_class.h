/* What lies between two antennas: values of `LinkClass` (path_loss.py). */
#ifndef MDRIVE_LINK_CLASS_H
#define MDRIVE_LINK_CLASS_H

enum { LOS, NLOSV, NLOSB };

#endif
