/* The compensator's work as a C programmer would write it: for each point, the segment of each of
 * three axes on an even grid, six error motions each by linear interpolation, and the lever rule of
 * the structure w b Y X Z t. Compiled by benchmarks/compensator.py only. */

#include <stddef.h>

/* positions, errors: n rows of Y X Z and of X Y Z, mm.  tables: axis by axis `nodes` rows of
 * E_X E_Y E_Z (mm) E_A E_B E_C (rad).  low, per_mm: where each grid begins, nodes per mm. */
void errors(size_t n, const double *positions, double *out, size_t nodes, const double *low,
            const double *per_mm, const double *tables, const double *tool)
{
    for (size_t i = 0; i < n; i++) {
        const double *q = positions + 3 * i;
        double m[3][6];
        for (int a = 0; a < 3; a++) {
            double t = (q[a] - low[a]) * per_mm[a];
            const double last = (double)(nodes - 1);
            t = t < 0.0 ? 0.0 : (t > last ? last : t);
            size_t k = (size_t)t;
            if (k > nodes - 2)
                k = nodes - 2;
            const double part = t - (double)k;
            const double *row = tables + (a * nodes + k) * 6;
            for (int c = 0; c < 6; c++)
                m[a][c] = row[c] + part * (row[c + 6] - row[c]);
        }
        /* levers: what moves behind each axis, and the tool */
        const double r[3][3] = {{q[1] + tool[0], tool[1], q[2] + tool[2]},
                                {tool[0], tool[1], q[2] + tool[2]},
                                {tool[0], tool[1], tool[2]}};
        double e[3] = {0.0, 0.0, 0.0};
        for (int a = 0; a < 3; a++) {
            e[0] += m[a][0] + m[a][4] * r[a][2] - m[a][5] * r[a][1];
            e[1] += m[a][1] + m[a][5] * r[a][0] - m[a][3] * r[a][2];
            e[2] += m[a][2] + m[a][3] * r[a][1] - m[a][4] * r[a][0];
        }
        for (int c = 0; c < 3; c++)
            out[3 * i + c] = e[c];
    }
}
