/* How large a table this build can fly. An export replaces this file by the exact sizes of its table;
   these are for a build that opens any. `ampi_table_open` refuses what is larger. */
#ifndef AMPI_CONFIG_H
#define AMPI_CONFIG_H

#ifndef AMPI_MAX_AXES
#define AMPI_MAX_AXES 12u /* parameters */
#endif
#ifndef AMPI_MAX_ROWS
#define AMPI_MAX_ROWS 16u /* states, control, gains or loads */
#endif
#ifndef AMPI_MAX_NODES
#define AMPI_MAX_NODES 256u /* low-density nodes */
#endif
#ifndef AMPI_MAX_SEGMENTS
#define AMPI_MAX_SEGMENTS 32u
#endif
#ifndef AMPI_MAX_DEGREE_NODES
#define AMPI_MAX_DEGREE_NODES 32u /* nodes of one segment */
#endif
#ifndef AMPI_MAX_POINTS
#define AMPI_MAX_POINTS 4096u /* high-density points */
#endif

#endif
