/* The largest table that this build opens; an export brings the exact sizes of its own. */
#ifndef AMPI_CONFIG_H
#define AMPI_CONFIG_H
#ifndef AMPI_MAX_AXES
#define AMPI_MAX_AXES 12u         /* parameters */
#define AMPI_MAX_ROWS 24u         /* states, control, gains or loads */
#define AMPI_MAX_NODES 256u       /* low-density nodes */
#define AMPI_MAX_SEGMENTS 32u
#define AMPI_MAX_DEGREE_NODES 32u /* nodes of one segment */
#define AMPI_MAX_POINTS 4096u     /* high-density points */
#endif
#endif
