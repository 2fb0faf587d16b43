/* The finite elements' inner loops: from displacements to residual, banded tangent and its solution.
 *
 * The same formulas as `assembly.py`, which holds without this library and says what they are. Between
 * `skinlab_strain` and `skinlab_assemble` any law can be asked in Python; sums of the terms that
 * `skinlab_potential` knows need not be.
 * Points are numbered through all elements; N = elements * points. Components of F in the order rr,
 * rz, zr, zz, hoop. Nothing is kept between calls: threads may share a mesh.
 */
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#if defined(__x86_64__) && defined(__gnu_linux__) && defined(__GNUC__) && !defined(__clang__)
/* One library for all processors of a kind; the loader picks. */
#define FAST __attribute__((target_clones("arch=x86-64-v4", "arch=x86-64-v3", "default")))
#else
#define FAST
#endif
#define INLINE static inline __attribute__((always_inline))
#if defined(__GNUC__) && !defined(__clang__)
#define APART _Pragma("GCC ivdep") /* rows of N that a loop writes do not overlap */
#else
#define APART
#endif

#define CHUNK 8       /* elements whose points are taken together, so that loops over points are long */
#define MOST_POINTS 9 /* of an element */
#define MOST_NODES 9
#define SPAN (CHUNK * MOST_POINTS)
#define BLOCK 8  /* columns that are factorised together */
#define TILE 8   /* rows that are kept in registers */

/* In one register of most processors: where there are none so wide, wider ones go through memory. */
typedef double Four __attribute__((vector_size(32), aligned(8)));

INLINE Four load4(const double *at) { return *(const Four *)at; }

typedef struct {
    int64_t elements, points, nodes; /* of each element */
    int64_t unknowns, width;         /* column j of the tangent begins at j * width */
    int64_t edges;
    const double *gradients;   /* (elements, 3, points, nodes): dN/dr, dN/dz, N/r */
    const double *by_node;     /* (elements, 3, nodes, points): the same */
    const double *volumes;     /* (elements, points) */
    const double *start;       /* (3, elements): F_rr, F_zz, F_hoop where nothing has moved */
    const int32_t *element;    /* (elements, nodes) */
    const int32_t *equations;  /* (elements, 2 nodes): r and z in turn; `unknowns` where it is fixed */
    const int32_t *slots;      /* (elements, 3, nodes, nodes): see `scatter` */
    const double *edge_form;   /* (edges, 3, 3, 3) */
    const double *edge_place;  /* (edges, 3, 2) */
    const int32_t *edge;       /* (edges, 3): nodes */
    const int32_t *edge_equations; /* (edges, 6) */
} Mesh;

/* The energy's derivatives at the points */
typedef struct {
    const double *i1, *i2, *j, *i1_i1, *i1_i2, *i2_i2, *i1_j, *i2_j, *j_j;
} Energy;

/* `w` (10, N): the energy and these, in the order of `Potential` */
INLINE Energy energy_at(const double *w, int64_t n) {
    return (Energy){w + n,     w + 2 * n, w + 3 * n, w + 4 * n, w + 5 * n,
                    w + 6 * n, w + 7 * n, w + 8 * n, w + 9 * n};
}

/* Symmetric 5 x 5, lower part by rows */
#define AT(i, k) ((i) * ((i) + 1) / 2 + (k))
#define PAIRS 15

/* The gradient of displacements `u` at the points of an element: rr, rz, zr, zz, hoop. */
INLINE void gradient(const Mesh *s, const int q, const int a, int64_t e, const double *restrict u,
                     double value[5][MOST_POINTS]) {
    for (int p = 0; p < q; p++) value[0][p] = value[1][p] = value[2][p] = value[3][p] = value[4][p] = 0;
    for (int k = 0; k < a; k++) {
        const int64_t node = s->element[e * a + k];
        const double ur = u[2 * node], uz = u[2 * node + 1];
        const double *g = s->by_node + (e * 3 * a + k) * q;
        for (int p = 0; p < q; p++) {
            value[0][p] += ur * g[p];
            value[1][p] += ur * g[a * q + p];
            value[2][p] += uz * g[p];
            value[3][p] += uz * g[a * q + p];
            value[4][p] += ur * g[2 * a * q + p];
        }
    }
}

INLINE void strain(const Mesh *s, const int q, const int a, int64_t e, const double *restrict u,
                   double *restrict f) {
    const int64_t n = s->elements * q, at = e * q;
    double value[5][MOST_POINTS];
    gradient(s, q, a, e, u, value);
    const double s0 = s->start[e], s1 = s->start[s->elements + e], s2 = s->start[2 * s->elements + e];
    APART for (int p = 0; p < q; p++) {
        const double rr = value[0][p] + s0, rz = value[1][p], zr = value[2][p];
        const double zz = value[3][p] + s1, hoop = value[4][p] + s2;
        const double plane = rr * rr + rz * rz + zr * zr + zz * zz, j = rr * zz - rz * zr;
        const double h2 = hoop * hoop;
        f[at + p] = rr;
        f[n + at + p] = rz;
        f[2 * n + at + p] = zr;
        f[3 * n + at + p] = zz;
        f[4 * n + at + p] = hoop;
        f[5 * n + at + p] = plane + h2;
        f[6 * n + at + p] = j * j + plane * h2;
        f[7 * n + at + p] = j * hoop;
    }
}

/* `out` (8, N) and two more: F, I1, I2 and det F, and the least and the largest det F, not a number where
 * one is not. */
FAST void skinlab_strain(const Mesh *s, const double *u, double *out) {
    const int64_t n = s->elements * s->points;
    const double *det = out + 7 * n;
    double least = INFINITY, most = -INFINITY, sum = 0;
    for (int64_t e = 0; e < s->elements; e++) {
        if (s->points == 9 && s->nodes == 8)
            strain(s, 9, 8, e, u, out);
        else
            strain(s, (int)s->points, (int)s->nodes, e, u, out);
    }
    for (int64_t p = 0; p < n; p++) {
        least = det[p] < least ? det[p] : least;
        most = det[p] > most ? det[p] : most;
        sum += det[p];
    }
    out[8 * n] = sum != sum ? NAN : least;
    out[8 * n + 1] = sum != sum ? NAN : most;
}

/* x^(-1/3) for `count` x > 0: a guess by the exponent, 4 % off at most, and steps that leave the third
 * power of what is off. Its loops become vectors, unlike those of `pow`. */
INLINE void inverse_cube_roots(int count, const double *restrict x, double *restrict y) {
    uint64_t bits[SPAN];
    memcpy(bits, x, count * sizeof *x);
    for (int p = 0; p < count; p++) bits[p] = (0x553ef0ff - (bits[p] >> 32) / 3) << 32;
    memcpy(y, bits, count * sizeof *x);
    for (int p = 0; p < count; p++)
        for (int k = 0; k < 3; k++) {
            const double off = 1 - x[p] * y[p] * y[p] * y[p];
            y[p] += y[p] * off * (1.0 / 3 + 2.0 / 9 * off);
        }
}

/* Energies that are known here are, in each element, sums of terms e1, e2, e1 e2, e1^3 and (J - 1)^2 / 2,
 * with e1 = J^(-2/3) I1 - 3 and e2 = J^(-4/3) I2 - 3, times numbers of its own, those of the next element
 * `apart` further: 0 where all are of one tissue. */
#define TERMS 5

/* At `count` points from `at` on, the numbers `c`: the energy and its derivatives. */
INLINE void potential(const double *restrict strain, int64_t n, int64_t at, int count,
                      const double c[TERMS][SPAN], double *restrict out) {
    const double *all1 = strain + 5 * n + at, *all2 = strain + 6 * n + at, *det = strain + 7 * n + at;
    double roots[SPAN], *w = out + at;
    inverse_cube_roots(count, det, roots);
    APART for (int p = 0; p < count; p++) {
        const double i1 = all1[p], i2 = all2[p], j = det[p];
        const double x1 = c[0][p], x2 = c[1][p], x12 = c[2][p], x111 = c[3][p], kappa = c[4][p];
        const double a = roots[p] * roots[p], b = a * a, inverse = 1 / j;
        const double e1 = a * i1 - 3, e2 = b * i2 - 3, change = j - 1;
        /* the slopes of e1 by I1 (a), of e2 by I2 (b), and theirs by J */
        const double a_j = -2.0 / 3 * a * inverse, b_j = -4.0 / 3 * b * inverse;
        const double e1_j = a_j * i1, e2_j = b_j * i2;
        const double e1_jj = -5.0 / 3 * e1_j * inverse, e2_jj = -7.0 / 3 * e2_j * inverse;
        const double w1 = x1 + x12 * e2 + 3 * x111 * e1 * e1, w2 = x2 + x12 * e1, w11 = 6 * x111 * e1;
        w[p] = e1 * (x1 + x12 * e2 + x111 * e1 * e1) + x2 * e2 + 0.5 * kappa * change * change;
        w[n + p] = w1 * a;
        w[2 * n + p] = w2 * b;
        w[3 * n + p] = w1 * e1_j + w2 * e2_j + kappa * change;
        w[4 * n + p] = w11 * a * a;
        w[5 * n + p] = x12 * a * b;
        w[6 * n + p] = 0;
        w[7 * n + p] = a * (w11 * e1_j + x12 * e2_j) + w1 * a_j;
        w[8 * n + p] = b * x12 * e1_j + w2 * b_j;
        w[9 * n + p] = e1_j * (w11 * e1_j + 2 * x12 * e2_j) + w1 * e1_jj + w2 * e2_jj + kappa;
    }
}

/* `out` (10, N): the energy and its derivatives from what `skinlab_strain` says. */
FAST void skinlab_potential(const Mesh *s, const double *strain, const double *form, int64_t apart,
                            double *out) {
    const int q = (int)s->points;
    for (int64_t e0 = 0; e0 < s->elements; e0 += CHUNK) {
        const int64_t left = s->elements - e0;
        const int many = left < CHUNK ? (int)left : CHUNK;
        double c[TERMS][SPAN];
        for (int k = 0; k < many; k++)
            for (int term = 0; term < TERMS; term++)
                for (int p = 0; p < q; p++) c[term][k * q + p] = form[(e0 + k) * apart + term];
        potential(strain, s->elements * q, e0 * q, many * q, (const double (*)[SPAN])c, out);
    }
}

/* First Piola-Kirchhoff stress at `count` points from `at` on. */
INLINE void stress_at(const double *restrict f, int64_t n, int64_t at, int count, const Energy *w,
                      const double *restrict extra, double stress[5][SPAN]) {
    const double *rr = f + at, *rz = f + n + at, *zr = f + 2 * n + at, *zz = f + 3 * n + at;
    const double *hp = f + 4 * n + at;
    const double *d1 = w->i1 + at, *d2 = w->i2 + at, *d3 = w->j + at;
    for (int p = 0; p < count; p++) {
        const double h = hp[p], h2 = h * h;
        const double a = rr[p] * rr[p] + rz[p] * rz[p] + zr[p] * zr[p] + zz[p] * zz[p];
        const double j = rr[p] * zz[p] - rz[p] * zr[p];
        const double wa = 2 * (d1[p] + h2 * d2[p]), wj = 2 * j * d2[p] + h * d3[p];
        stress[0][p] = wa * rr[p] + wj * zz[p];
        stress[1][p] = wa * rz[p] - wj * zr[p];
        stress[2][p] = wa * zr[p] - wj * rz[p];
        stress[3][p] = wa * zz[p] + wj * rr[p];
        stress[4][p] = 2 * h * (d1[p] + a * d2[p]) + j * d3[p];
    }
    if (extra) {
        const double *s0 = extra + at, *s1 = extra + n + at, *s2 = extra + 2 * n + at;
        const double *s3 = extra + 3 * n + at;
        for (int p = 0; p < count; p++) {
            stress[0][p] += rr[p] * s0[p] + rz[p] * s1[p];
            stress[1][p] += rr[p] * s1[p] + rz[p] * s2[p];
            stress[2][p] += zr[p] * s0[p] + zz[p] * s1[p];
            stress[3][p] += zr[p] * s1[p] + zz[p] * s2[p];
            stress[4][p] += hp[p] * s3[p];
        }
    }
}

/* The second derivative of the energy by F at `count` points from `at` on. */
INLINE void moduli_at(const double *restrict f, int64_t n, int64_t at, int count, const Energy *w,
                      const double *restrict extra, double c[PAIRS][SPAN]) {
    const double *frr = f + at, *frz = f + n + at, *fzr = f + 2 * n + at, *fzz = f + 3 * n + at;
    const double *hp = f + 4 * n + at;
    for (int p = 0; p < count; p++) {
        const double f0 = frr[p], f1 = frz[p], f2 = fzr[p], f3 = fzz[p], h = hp[p], h2 = h * h;
        const double c0 = f3, c1 = -f2, c2 = -f1, c3 = f0;
        const double a = f0 * f0 + f1 * f1 + f2 * f2 + f3 * f3, j = f0 * f3 - f1 * f2;
        const double d1 = w->i1[at + p], d2 = w->i2[at + p], d3 = w->j[at + p];
        const double d11 = w->i1_i1[at + p], d12 = w->i1_i2[at + p], d22 = w->i2_i2[at + p];
        const double d13 = w->i1_j[at + p], d23 = w->i2_j[at + p], d33 = w->j_j[at + p];
        const double j2 = 2 * j, h_2 = 2 * h;
        const double wa = d1 + h2 * d2, wj = j2 * d2 + h * d3, byf = d1 + a * d2;
        const double a1 = d11 + h2 * d12, a2 = d12 + h2 * d22, a3 = d13 + h2 * d23;
        const double jj2 = j2 * d22 + h * d23, jj3 = j2 * d23 + h * d33;
        const double g1 = d11 + a * d12, g2 = d12 + a * d22, g3 = d13 + a * d23;
        const double waa = 4 * (a1 + h2 * a2), waj = 2 * (j2 * a2 + h * a3);
        const double wjj = 2 * d2 + j2 * jj2 + h * jj3;
        const double waf = 2 * (h_2 * (d2 + a1 + a * a2) + j * a3);
        const double wjf = d3 + h_2 * (j2 * g2 + h * g3) + j * jj3;
        const double wff = 2 * byf + h_2 * (h_2 * (g1 + a * g2) + 2 * j * g3) + j * j * d33;
        const double l0 = waa * f0 + waj * c0, l1 = waa * f1 + waj * c1;
        const double l2 = waa * f2 + waj * c2, l3 = waa * f3 + waj * c3;
        const double r0 = waj * f0 + wjj * c0, r1 = waj * f1 + wjj * c1;
        const double r2 = waj * f2 + wjj * c2, r3 = waj * f3 + wjj * c3;
        c[AT(0, 0)][p] = l0 * f0 + r0 * c0 + 2 * wa;
        c[AT(1, 0)][p] = l1 * f0 + r1 * c0;
        c[AT(1, 1)][p] = l1 * f1 + r1 * c1 + 2 * wa;
        c[AT(2, 0)][p] = l2 * f0 + r2 * c0;
        c[AT(2, 1)][p] = l2 * f1 + r2 * c1 - wj;
        c[AT(2, 2)][p] = l2 * f2 + r2 * c2 + 2 * wa;
        c[AT(3, 0)][p] = l3 * f0 + r3 * c0 + wj;
        c[AT(3, 1)][p] = l3 * f1 + r3 * c1;
        c[AT(3, 2)][p] = l3 * f2 + r3 * c2;
        c[AT(3, 3)][p] = l3 * f3 + r3 * c3 + 2 * wa;
        c[AT(4, 0)][p] = waf * f0 + wjf * c0;
        c[AT(4, 1)][p] = waf * f1 + wjf * c1;
        c[AT(4, 2)][p] = waf * f2 + wjf * c2;
        c[AT(4, 3)][p] = waf * f3 + wjf * c3;
        c[AT(4, 4)][p] = wff;
    }
    if (extra) {
        for (int p = 0; p < count; p++) {
            const double rr = extra[at + p], rz = extra[n + at + p], zz = extra[2 * n + at + p];
            c[AT(0, 0)][p] += rr;
            c[AT(1, 0)][p] += rz;
            c[AT(1, 1)][p] += zz;
            c[AT(2, 2)][p] += rr;
            c[AT(3, 2)][p] += rz;
            c[AT(3, 3)][p] += zz;
            c[AT(4, 4)][p] += extra[3 * n + at + p];
        }
    }
}

INLINE void force_of(const Mesh *s, const int q, const int a, int64_t e, int first,
                     const double stress[5][SPAN], double *restrict force) {
    double fr[MOST_NODES] = {0}, fz[MOST_NODES] = {0};
    for (int p = 0; p < q; p++) {
        const double *gr = s->gradients + (e * 3 * q + p) * a, *gz = gr + q * a, *gh = gz + q * a;
        const double w = s->volumes[e * q + p];
        const double s0 = w * stress[0][first + p], s1 = w * stress[1][first + p];
        const double s2 = w * stress[2][first + p], s3 = w * stress[3][first + p];
        const double s4 = w * stress[4][first + p];
        for (int k = 0; k < a; k++) {
            fr[k] += s0 * gr[k] + s1 * gz[k] + s4 * gh[k];
            fz[k] += s2 * gr[k] + s3 * gz[k];
        }
    }
    const int32_t *eq = s->equations + e * 2 * a;
    for (int k = 0; k < a; k++) {
        force[eq[2 * k]] += fr[k];
        force[eq[2 * k + 1]] += fz[k];
    }
}

/* `slots` are places in the band for rr, rz and zz of each pair of nodes. */
INLINE void scatter(const int a, const int32_t *slots, const double *rr, const double *rz,
                    const double *zz, double *restrict band) {
    for (int i = 0; i < a; i++) {
        for (int k = 0; k <= i; k++) {
            band[slots[a * i + k]] += rr[a * i + k];
            band[slots[2 * a * a + a * i + k]] += zz[a * i + k];
        }
        for (int k = 0; k < a; k++) band[slots[a * a + a * i + k]] += rz[a * i + k];
    }
}

INLINE void stiffness_of(const Mesh *s, int64_t e, int first, const double c[PAIRS][SPAN],
                         double *restrict band) {
    const int q = (int)s->points, a = (int)s->nodes;
    double rr[MOST_NODES * MOST_NODES] = {0}, rz[MOST_NODES * MOST_NODES] = {0};
    double zz[MOST_NODES * MOST_NODES] = {0};
    for (int p = 0; p < q; p++) {
        const double *gr = s->gradients + (e * 3 * q + p) * a, *gz = gr + q * a, *gh = gz + q * a;
        const double w = s->volumes[e * q + p];
        double d[PAIRS];
        for (int k = 0; k < PAIRS; k++) d[k] = w * c[k][first + p];
        for (int k = 0; k < a; k++) {
            const double x = gr[k], y = gz[k], h = gh[k];
            const double t0 = d[AT(0, 0)] * x + d[AT(1, 0)] * y + d[AT(4, 0)] * h;
            const double t1 = d[AT(1, 0)] * x + d[AT(1, 1)] * y + d[AT(4, 1)] * h;
            const double t4 = d[AT(4, 0)] * x + d[AT(4, 1)] * y + d[AT(4, 4)] * h;
            const double u0 = d[AT(2, 0)] * x + d[AT(3, 0)] * y;
            const double u1 = d[AT(2, 1)] * x + d[AT(3, 1)] * y;
            const double u4 = d[AT(4, 2)] * x + d[AT(4, 3)] * y;
            const double v2 = d[AT(2, 2)] * x + d[AT(3, 2)] * y;
            const double v3 = d[AT(3, 2)] * x + d[AT(3, 3)] * y;
            for (int i = 0; i < a; i++) {
                rr[a * i + k] += gr[i] * t0 + gz[i] * t1 + gh[i] * t4;
                rz[a * i + k] += gr[i] * u0 + gz[i] * u1 + gh[i] * u4;
                zz[a * i + k] += gr[i] * v2 + gz[i] * v3;
            }
        }
    }
    scatter(a, s->slots + e * 3 * a * a, rr, rz, zz, band);
}

/* The same for 8 nodes: half a row of the stiffness is one vector. What a point adds to it is kept of all
 * points first, so that two half rows at a time stay in registers. */
INLINE void stiffness_of_8(const Mesh *s, int64_t e, int first, const double c[PAIRS][SPAN],
                           double *restrict band) {
    const int q = (int)s->points;
    const double *gradients = s->gradients + e * 24 * q;
    double rr[64], rz[64], zz[64];
    for (int half = 0; half < 8; half += 4) {
        Four t[MOST_POINTS][8];
        for (int p = 0; p < q; p++) {
            const double *g = gradients + p * 8 + half;
            const double w = s->volumes[e * q + p];
            const Four x = w * load4(g), y = w * load4(g + 8 * q), h = w * load4(g + 16 * q);
#define D(i, k) c[AT(i, k)][first + p]
            t[p][0] = D(0, 0) * x + D(1, 0) * y + D(4, 0) * h;
            t[p][1] = D(1, 0) * x + D(1, 1) * y + D(4, 1) * h;
            t[p][2] = D(4, 0) * x + D(4, 1) * y + D(4, 4) * h;
            t[p][3] = D(2, 0) * x + D(3, 0) * y;
            t[p][4] = D(2, 1) * x + D(3, 1) * y;
            t[p][5] = D(4, 2) * x + D(4, 3) * y;
            t[p][6] = D(2, 2) * x + D(3, 2) * y;
            t[p][7] = D(3, 2) * x + D(3, 3) * y;
#undef D
        }
        for (int i = 0; i < 8; i++) {
            Four a = {0}, b = {0}, d = {0};
            for (int p = 0; p < q; p++) {
                const double *g = gradients + p * 8 + i;
                const double x = g[0], y = g[8 * q], h = g[16 * q];
                a += x * t[p][0] + y * t[p][1] + h * t[p][2];
                b += x * t[p][3] + y * t[p][4] + h * t[p][5];
                d += x * t[p][6] + y * t[p][7];
            }
            *(Four *)(rr + 8 * i + half) = a;
            *(Four *)(rz + 8 * i + half) = b;
            *(Four *)(zz + 8 * i + half) = d;
        }
    }
    scatter(8, s->slots + e * 192, rr, rz, zz, band);
}

INLINE void add(const Mesh *s, double *restrict band, int32_t i, int32_t k, double value) {
    const int32_t col = i < k ? i : k, row = i < k ? k : i;
    if (row < s->unknowns) band[col * s->width + (row - col)] += value;
}

/* The follower pressure on the deformed surface; returns the volume under the dome. */
static double suction(const Mesh *s, const double *u, double pressure, double *band, double *load) {
    double volume = 0;
    for (int64_t e = 0; e < s->edges; e++) {
        const double *t = s->edge_form + 27 * e;
        const int32_t *eq = s->edge_equations + 6 * e;
        double r[3], z[3], tr[3][3] = {{0}}, tdr[3][3] = {{0}}, tdz[3][3] = {{0}}, k[6][6] = {{0}};
        for (int b = 0; b < 3; b++) {
            const int64_t node = s->edge[3 * e + b];
            r[b] = s->edge_place[6 * e + 2 * b] + u[2 * node];
            z[b] = s->edge_place[6 * e + 2 * b + 1] + u[2 * node + 1];
        }
        for (int a = 0; a < 3; a++)
            for (int b = 0; b < 3; b++)
                for (int c = 0; c < 3; c++) {
                    const double form = t[9 * a + 3 * b + c];
                    tr[a][c] += form * r[b];
                    tdr[a][b] += form * r[c];
                    tdz[a][b] += form * z[c];
                }
        for (int a = 0; a < 3; a++) {
            double fr = 0, fz = 0;
            for (int c = 0; c < 3; c++) {
                fz += tr[a][c] * r[c];
                fr -= tr[a][c] * z[c];
                k[2 * a + 1][2 * c] = tr[a][c] + tdr[a][c];
                k[2 * a][2 * c + 1] = -tr[a][c];
                k[2 * a][2 * c] = -tdz[a][c];
            }
            volume += fz * z[a];
            load[eq[2 * a]] += fr;
            load[eq[2 * a + 1]] += fz;
        }
        if (band)
            for (int a = 0; a < 6; a++)
                for (int b = 0; b <= a; b++)
                    add(s, band, eq[a], eq[b], -pressure * 0.5 * (k[a][b] + k[b][a]));
    }
    return volume;
}

/* `band` has whole blocks of columns and one entry more; `internal` and `load` (unknowns + 1) are zero on
 * entry; `extra` (4, N) is a second Piola-Kirchhoff stress, or nothing. Returns the volume under the
 * dome. */
FAST double skinlab_assemble(const Mesh *s, const double *u, const double *f, const double *energy,
                             const double *extra, double pressure, double *band, double *internal,
                             double *load) {
    const int q = (int)s->points, a = (int)s->nodes;
    const int64_t n = s->elements * q;
    const int64_t columns = (s->unknowns + BLOCK - 1) / BLOCK * BLOCK;
    const Energy w = energy_at(energy, n);
    double c[PAIRS][SPAN], stress[5][SPAN];
    memset(band, 0, (columns * s->width + 1) * sizeof *band);
    for (int64_t e0 = 0; e0 < s->elements; e0 += CHUNK) {
        const int64_t left = s->elements - e0;
        const int many = left < CHUNK ? (int)left : CHUNK;
        stress_at(f, n, e0 * q, many * q, &w, extra, stress);
        moduli_at(f, n, e0 * q, many * q, &w, extra, c);
        for (int k = 0; k < many; k++) {
            if (q == 9 && a == 8) {
                force_of(s, 9, 8, e0 + k, 9 * k, (const double (*)[SPAN])stress, internal);
                stiffness_of_8(s, e0 + k, 9 * k, (const double (*)[SPAN])c, band);
            } else {
                force_of(s, q, a, e0 + k, q * k, (const double (*)[SPAN])stress, internal);
                if (a == 8)
                    stiffness_of_8(s, e0 + k, q * k, (const double (*)[SPAN])c, band);
                else
                    stiffness_of(s, e0 + k, q * k, (const double (*)[SPAN])c, band);
            }
        }
    }
    return suction(s, u, pressure, band, load);
}

INLINE void rates(const Mesh *s, const int q, const int a, int64_t e, const double *restrict f,
                  const double *restrict v, double *restrict out) {
    const int64_t n = s->elements * q, at = e * q;
    double value[5][MOST_POINTS];
    gradient(s, q, a, e, v, value);
    APART for (int p = 0; p < q; p++) {
        const double rr = f[at + p], rz = f[n + at + p], zr = f[2 * n + at + p], zz = f[3 * n + at + p];
        const double h = f[4 * n + at + p], w = s->volumes[at + p], dh = value[4][p];
        const double plane = rr * rr + rz * rz + zr * zr + zz * zz, j = rr * zz - rz * zr;
        const double d_plane = 2 * (rr * value[0][p] + rz * value[1][p] + zr * value[2][p] + zz * value[3][p]);
        const double d_j = zz * value[0][p] - zr * value[1][p] - rz * value[2][p] + rr * value[3][p];
        out[at + p] = w * (d_plane + 2 * h * dh);
        out[n + at + p] = w * (2 * j * d_j + h * h * d_plane + 2 * h * plane * dh);
        out[2 * n + at + p] = w * (h * d_j + j * dh);
    }
}

/* How I1, I2 and det F (3, N) change along displacements `v`, times the points' volumes, and the load. */
FAST void skinlab_rates(const Mesh *s, const double *u, const double *strain, const double *v, double *out,
                        double *load) {
    for (int64_t e = 0; e < s->elements; e++) {
        if (s->points == 9 && s->nodes == 8)
            rates(s, 9, 8, e, strain, v, out);
        else
            rates(s, (int)s->points, (int)s->nodes, e, strain, v, out);
    }
    suction(s, u, 0.0, 0, load);
}

/* How `many` energies change, from what `skinlab_strain` and `skinlab_rates` say; the form of the next one
 * begins `next` further. */
FAST void skinlab_work(const Mesh *s, const double *strain, const double *rate, int64_t many,
                       const double *form, int64_t next, int64_t apart, double *out) {
    const int q = (int)s->points;
    const int64_t n = s->elements * q;
    const double *all1 = strain + 5 * n, *all2 = strain + 6 * n, *det = strain + 7 * n;
    for (int64_t k = 0; k < many; k++) out[k] = 0;
    for (int64_t e = 0; e < s->elements; e++) {
        double t[TERMS][MOST_POINTS], roots[MOST_POINTS], sum[TERMS] = {0};
        inverse_cube_roots(q, det + e * q, roots);
        for (int p = 0; p < q; p++) {
            const int64_t at = e * q + p;
            const double j = det[at], a = roots[p] * roots[p], b = a * a;
            const double j1 = a * all1[at], j2 = b * all2[at], e1 = j1 - 3, e2 = j2 - 3;
            const double share = rate[2 * n + at] / (3 * j);
            const double d1 = a * rate[at] - 2 * share * j1, d2 = b * rate[n + at] - 4 * share * j2;
            t[0][p] = d1;
            t[1][p] = d2;
            t[2][p] = e2 * d1 + e1 * d2;
            t[3][p] = 3 * e1 * e1 * d1;
            t[4][p] = (j - 1) * rate[2 * n + at];
        }
        for (int term = 0; term < TERMS; term++)
            for (int p = 0; p < q; p++) sum[term] += t[term][p];
        for (int64_t k = 0; k < many; k++)
            for (int term = 0; term < TERMS; term++) out[k] += form[k * next + e * apart + term] * sum[term];
    }
}

/* The least eigenvalue of the acoustic tensor over directions in the r-z plane and over all points. */
FAST double skinlab_ellipticity(const Mesh *s, const double *f, const double *energy, const double *extra) {
    const int q = (int)s->points;
    const int64_t n = s->elements * q;
    const Energy w = energy_at(energy, n);
    double c[PAIRS][SPAN], least[SPAN], sum[SPAN], result = INFINITY;
    for (int64_t at = 0; at < n; at += SPAN) {
        const int count = n - at < SPAN ? (int)(n - at) : SPAN;
        moduli_at(f, n, at, count, &w, extra, c);
        for (int p = 0; p < count; p++) least[p] = INFINITY, sum[p] = 0;
        for (int angle = 0; angle < 8; angle++) {
            const double x = cos(angle * 3.14159265358979323846 / 8);
            const double y = sin(angle * 3.14159265358979323846 / 8);
            const double xx = x * x, xy = x * y, yy = y * y;
            for (int p = 0; p < count; p++) {
                const double rr = xx * c[AT(0, 0)][p] + 2 * xy * c[AT(1, 0)][p] + yy * c[AT(1, 1)][p];
                const double zz = xx * c[AT(2, 2)][p] + 2 * xy * c[AT(3, 2)][p] + yy * c[AT(3, 3)][p];
                const double rz = xx * c[AT(2, 0)][p] + xy * (c[AT(3, 0)][p] + c[AT(2, 1)][p]) +
                                  yy * c[AT(3, 1)][p];
                const double half = 0.5 * (rr - zz);
                const double value = 0.5 * (rr + zz) - sqrt(half * half + rz * rz);
                least[p] = value < least[p] ? value : least[p];
                sum[p] += value; /* not a number where one is not */
            }
        }
        for (int p = 0; p < count; p++) {
            if (sum[p] != sum[p]) return NAN;
            result = least[p] < result ? least[p] : result;
        }
    }
    return result;
}

/* SHA-256 of this file when it was compiled: an older library is not used. */
const char *skinlab_source(void) { return SKINLAB_SOURCE; }

/* ---- Cholesky factor of a banded matrix ----
 *
 * Entry (i, j), i >= j, is at j * width + i - j: a matrix with the leading dimension width - 1. Columns
 * are longer than the band by zeros, BLOCK + TILE of them, and there are whole blocks of columns, so
 * that no loop has to look where the band ends.
 */
/* Takes from 8 rows of 4 columns, `here`, what the columns k to `end` have in common with them: `rows` and
 * `columns` point at column k, row and column; eight sums stay in registers. */
INLINE void eliminate(const double *rows, const double *columns, int64_t ld, int64_t k, int64_t end,
                      Four sum[8]) {
    Four a0 = sum[0], a1 = sum[1], a2 = sum[2], a3 = sum[3];
    Four b0 = sum[4], b1 = sum[5], b2 = sum[6], b3 = sum[7];
    for (; k < end; k++, rows += ld, columns += ld) {
        const Four a = load4(rows), b = load4(rows + 4);
        a0 -= a * columns[0], a1 -= a * columns[1], a2 -= a * columns[2], a3 -= a * columns[3];
        b0 -= b * columns[0], b1 -= b * columns[1], b2 -= b * columns[2], b3 -= b * columns[3];
    }
    sum[0] = a0, sum[1] = a1, sum[2] = a2, sum[3] = a3;
    sum[4] = b0, sum[5] = b1, sum[6] = b2, sum[7] = b3;
}

/* 8 rows from i0 on of 4 columns from j on: `k` is the first column that reaches the rows. `low` points at
 * the factor of the columns themselves, `scale` at 1 / its diagonal. */
INLINE void below(double *band, int64_t ld, int64_t k, int64_t i0, int64_t j, const double *scale) {
    double *here = band + j * ld + i0;
    const double *low = band + j * ld + j;
    Four x[8];
    for (int c = 0; c < 4; c++) x[c] = load4(here + c * ld), x[4 + c] = load4(here + c * ld + 4);
    eliminate(band + k * ld + i0, band + k * ld + j, ld, k, j, x);
    for (int c = 0; c < 4; c++) {
        for (int d = 0; d < c; d++) {
            const double common = low[d * ld + c];
            x[c] -= x[d] * common, x[4 + c] -= x[4 + d] * common;
        }
        x[c] *= scale[c], x[4 + c] *= scale[c];
        *(Four *)(here + c * ld) = x[c], *(Four *)(here + c * ld + 4) = x[4 + c];
    }
}

FAST int64_t skinlab_factorise(int64_t unknowns, int64_t width, double *band, double *inverse) {
    const int64_t ld = width - 1, reach = width - 1 - BLOCK - TILE; /* of the band itself */
    for (int64_t j = unknowns; j % BLOCK; j++) band[j * width] = 1.0;
    for (int64_t j0 = 0; j0 < unknowns; j0 += BLOCK) {
        for (int64_t j = j0; j < j0 + BLOCK; j += 4) { /* the block on the diagonal, and what is above it */
            const int64_t k = j0 - reach > 0 ? j0 - reach : 0;
            double *here = band + j * ld + j0;
            double x[4][8];
            Four sum[8];
            for (int c = 0; c < 4; c++) sum[c] = load4(here + c * ld), sum[4 + c] = load4(here + c * ld + 4);
            eliminate(band + k * ld + j0, band + k * ld + j, ld, k, j, sum);
            for (int c = 0; c < 4; c++) *(Four *)x[c] = sum[c], *(Four *)(x[c] + 4) = sum[4 + c];
            for (int c = 0; c < 4; c++) {
                const int row = (int)(j - j0) + c;
                const double square = x[c][row];
                if (!(square > 0.0) || !isfinite(square)) return j + c + 1;
                const double scale = 1.0 / sqrt(square);
                inverse[j + c] = scale;
                Four low = scale * load4(x[c]), high = scale * load4(x[c] + 4);
                *(Four *)x[c] = low, *(Four *)(x[c] + 4) = high;
                for (int d = c + 1; d < 4; d++) {
                    const double common = x[c][row - c + d];
                    *(Four *)x[d] -= low * common, *(Four *)(x[d] + 4) -= high * common;
                }
                for (int i = row; i < BLOCK; i++) here[c * ld + i] = x[c][i];
            }
        }
        for (int64_t i0 = j0 + BLOCK; i0 < j0 + BLOCK + reach; i0 += TILE) {
            const int64_t k = i0 - reach > 0 ? i0 - reach : 0;
            below(band, ld, k, i0, j0, inverse + j0);
            below(band, ld, k, i0, j0 + 4, inverse + j0 + 4);
        }
    }
    return 0;
}

/* `right` (many, stride) holds right sides, zeros behind each, and becomes solutions; the stride is at
 * least unknowns + width. */
FAST void skinlab_solve(int64_t unknowns, int64_t width, const double *band, const double *inverse,
                        int64_t many, int64_t stride, double *right) {
    const int64_t ld = width - 1, reach = width - 1 - BLOCK - TILE;
    const int64_t last = (unknowns - 1) / BLOCK * BLOCK;
    for (int64_t r = 0; r < many; r++) {
        double *x = right + r * stride;
        for (int64_t j0 = 0; j0 <= last; j0 += BLOCK) {
            const double *columns = band + j0 * ld;
            double y[BLOCK];
            for (int c = 0; c < BLOCK; c++) {
                double value = x[j0 + c];
                for (int d = 0; d < c; d++) value -= columns[d * ld + j0 + c] * y[d];
                y[c] = value * inverse[j0 + c];
                x[j0 + c] = y[c];
            }
            for (int64_t i = j0 + BLOCK; i < j0 + BLOCK + reach; i += 8) {
                Four a = load4(x + i), b = load4(x + i + 4), other_a = {0}, other_b = {0};
                for (int c = 0; c < BLOCK; c += 2) {
                    const double *one = columns + c * ld + i, *other = one + ld;
                    a -= y[c] * load4(one), b -= y[c] * load4(one + 4);
                    other_a -= y[c + 1] * load4(other), other_b -= y[c + 1] * load4(other + 4);
                }
                *(Four *)(x + i) = a + other_a, *(Four *)(x + i + 4) = b + other_b;
            }
        }
        for (int64_t j = unknowns; j < stride; j++) x[j] = 0;
        for (int64_t j0 = last; j0 >= 0; j0 -= BLOCK) {
            const double *columns = band + j0 * ld;
            double sum[BLOCK][8];
            for (int c = 0; c < BLOCK; c += 4) {
                const double *at = columns + c * ld;
                Four a0 = {0}, a1 = {0}, a2 = {0}, a3 = {0}, b0 = {0}, b1 = {0}, b2 = {0}, b3 = {0};
                for (int64_t i = j0 + BLOCK; i < j0 + BLOCK + reach; i += 8) {
                    const Four a = load4(x + i), b = load4(x + i + 4);
                    a0 += a * load4(at + i), b0 += b * load4(at + i + 4);
                    a1 += a * load4(at + ld + i), b1 += b * load4(at + ld + i + 4);
                    a2 += a * load4(at + 2 * ld + i), b2 += b * load4(at + 2 * ld + i + 4);
                    a3 += a * load4(at + 3 * ld + i), b3 += b * load4(at + 3 * ld + i + 4);
                }
                *(Four *)sum[c] = a0, *(Four *)sum[c + 1] = a1, *(Four *)sum[c + 2] = a2;
                *(Four *)sum[c + 3] = a3, *(Four *)(sum[c] + 4) = b0, *(Four *)(sum[c + 1] + 4) = b1;
                *(Four *)(sum[c + 2] + 4) = b2, *(Four *)(sum[c + 3] + 4) = b3;
            }
            for (int c = BLOCK - 1; c >= 0; c--) {
                const double *t = sum[c];
                double value = x[j0 + c] - (((t[0] + t[4]) + (t[1] + t[5])) + ((t[2] + t[6]) + (t[3] + t[7])));
                for (int d = c + 1; d < BLOCK; d++) value -= columns[c * ld + j0 + d] * x[j0 + d];
                x[j0 + c] = value * inverse[j0 + c];
            }
        }
    }
}

/* Values of the B-splines that are not zero at `x`, or their slopes; returns the first of them. */
static int64_t local_basis(const double *knots, int64_t size, int64_t degree, double x, int slope,
                           double *values) {
    int64_t piece = degree, high = size; /* knots[piece] <= x < knots[high], or an end */
    while (high - piece > 1) {
        const int64_t middle = (piece + high) / 2;
        if (x >= knots[middle]) piece = middle;
        else high = middle;
    }
    values[0] = degree || !slope;
    for (int64_t k = 1; k <= degree; k++) {
        double saved = 0;
        for (int64_t i = 0; i < k; i++) {
            const double right = knots[piece + i + 1], left = knots[piece + i + 1 - k];
            const double share = values[i] / (right - left);
            if (slope && k == degree) {
                values[i] = saved - k * share;
                saved = k * share;
            } else {
                values[i] = saved + (right - x) * share;
                saved = (x - left) * share;
            }
        }
        values[k] = saved;
    }
    return piece - degree;
}

#define MOST_AXES 16
#define MOST_WIDE 64 /* degree + 1 */

/* A spline along d axes with `sizes` and `degrees`, all knots end to end, coefficients (rows, k), at
 * `at` (points, d): values `out` (points, k), or with `slopes` the slopes along each axis, (points, d, k).
 * Returns 0, or 1 where there are more axes or higher degrees than it has room for. */
FAST int64_t skinlab_spline(int64_t points, int64_t d, const int64_t *sizes, const int64_t *degrees,
                            const double *knots, const double *at, int64_t slopes,
                            const double *coefficients, int64_t k, double *out) {
    double basis[MOST_AXES][MOST_WIDE], rise[MOST_AXES][MOST_WIDE];
    int64_t stride[MOST_AXES], place[MOST_AXES], rows = 1;
    const int64_t kinds = slopes ? d : 1;
    if (d > MOST_AXES) return 1;
    for (int64_t i = d - 1; i >= 0; i--) {
        if (degrees[i] + 1 > MOST_WIDE) return 1;
        stride[i] = rows, rows *= sizes[i];
    }
    memset(out, 0, points * kinds * k * sizeof *out);
    for (int64_t p = 0; p < points; p++) {
        double *restrict sum = out + p * kinds * k;
        const double *t = knots;
        int64_t row = 0;
        for (int64_t i = 0; i < d; i++) {
            row += stride[i] * local_basis(t, sizes[i], degrees[i], at[p * d + i], 0, basis[i]);
            if (slopes) local_basis(t, sizes[i], degrees[i], at[p * d + i], 1, rise[i]);
            t += sizes[i] + degrees[i] + 1;
            place[i] = 0;
        }
        for (;;) {
            double weight[MOST_AXES]; /* of each kind: the product of all axes but the last */
            int64_t here = row, i = d - 2;
            for (int64_t kind = 0; kind < kinds; kind++) {
                weight[kind] = 1;
                for (int64_t a = 0; a < d - 1; a++)
                    weight[kind] *= (slopes && a == kind ? rise : basis)[a][place[a]];
            }
            for (int64_t a = 0; a < d - 1; a++) here += place[a] * stride[a];
            for (int64_t last = 0; last <= degrees[d - 1]; last++) {
                const double *restrict from = coefficients + (here + last) * k;
                for (int64_t kind = 0; kind < kinds; kind++) {
                    const double w = weight[kind] * (slopes && kind == d - 1 ? rise : basis)[d - 1][last];
                    for (int64_t c = 0; c < k; c++) sum[kind * k + c] += w * from[c];
                }
            }
            while (i >= 0 && ++place[i] > degrees[i]) place[i--] = 0;
            if (i < 0) break;
        }
    }
    return 0;
}

/* A cubic spline of each row: values `out` (n, m) at `at` (n, m) of coefficients (n, size). Beyond the ends
 * it is what it is there. */
FAST void skinlab_splines(int64_t n, int64_t m, int64_t size, const double *knots, const double *coefficients,
                          const double *at, double *out) {
    const double low = knots[0], high = knots[size + 3];
    for (int64_t i = 0; i < n; i++)
        for (int64_t j = 0; j < m; j++) {
            double x = at[i * m + j], basis[4];
            x = x < low ? low : x > high ? high : x;
            const double *from = coefficients + i * size + local_basis(knots, size, 3, x, 0, basis);
            out[i * m + j] = from[0] * basis[0] + from[1] * basis[1] + from[2] * basis[2] + from[3] * basis[3];
        }
}

/* `skinlab.discrepancy.table_domes.Domes`: deflections `out` (n, m) at suctions (rows, m), of one row for all
 * or of n. `alike`: the nodes of all are at the same suctions. `room` (m, 2) is for what they share. */
FAST void skinlab_domes(int64_t n, int64_t m, int64_t cells, int64_t rows, int64_t alike,
                        const double *coefficients, const double *scale, const double *begin,
                        const double *step, const double *pressure, double *restrict room, double *restrict out) {
    for (int64_t i = 0; i < n; i++) {
        const double low = scale[i] * sinh(begin[i]), high = scale[i] * sinh(begin[i] + cells * step[i]);
        const double *p = pressure + (rows > 1 ? i : 0) * m;
        if (!i || !alike || rows > 1)
            for (int64_t j = 0; j < m; j++) {
                const double within = p[j] < low ? low : p[j] > high ? high : p[j];
                room[2 * j] = (asinh(within / scale[i]) - begin[i]) / step[i];
                room[2 * j + 1] = p[j] - within;
            }
        for (int64_t j = 0; j < m; j++) {
            const double place = room[2 * j], beyond = room[2 * j + 1];
            const int64_t cell = place > 0 ? place < cells - 1 ? (int64_t)place : cells - 1 : 0; /* NaN: 0 */
            const double x = place - cell, *c = coefficients + (i * cells + cell) * 4;
            double w = ((c[0] * x + c[1]) * x + c[2]) * x + c[3];
            if (beyond != 0)
                w += beyond * ((3 * c[0] * x + 2 * c[1]) * x + c[2]) / (step[i] * hypot(p[j] - beyond, scale[i]));
            out[i * m + j] = w;
        }
    }
}

/* L diag(d) L' of a tridiagonal matrix, in place: `diagonal` (n) becomes d, `beside` (n - 1) what is below
 * the ones of L. Returns 0, or where it is not positive definite, from 1. */
FAST int64_t skinlab_tridiagonal(int64_t n, double *diagonal, double *beside) {
    for (int64_t i = 0; i < n; i++) {
        if (!(diagonal[i] > 0.0)) return i + 1;
        if (i + 1 < n) {
            const double e = beside[i];
            beside[i] = e / diagonal[i];
            diagonal[i + 1] -= beside[i] * e;
        }
    }
    return 0;
}

/* Solves with L, ones and `below` (n - 1), or with its transpose, in place: `right` (n, many) by rows. */
FAST void skinlab_bidiagonal(int64_t n, int64_t many, const double *below, int64_t transposed,
                             double *restrict right) {
    if (transposed)
        for (int64_t i = n - 2; i >= 0; i--)
            for (int64_t k = 0; k < many; k++) right[i * many + k] -= below[i] * right[(i + 1) * many + k];
    else
        for (int64_t i = 1; i < n; i++)
            for (int64_t k = 0; k < many; k++) right[i * many + k] -= below[i - 1] * right[(i - 1) * many + k];
}

#define ROWS 32 /* samples that are taken together */

/* A curve, and those of all columns that are not zero in it: most are zeros or polynomials of other curves. */
typedef struct {
    int64_t begin, samples, columns, alone, width;
    double *x;      /* (samples + 1, width), with what is before the first sample */
    int64_t *own;   /* (columns) which they are: those alone, that are to be integrated out, come first */
    int64_t *place; /* (columns) and where they are in the sums */
} Curve;

/* For one curve at a time. */
typedef struct {
    double *white, *gram, *taken, *inverse, *last, *row, *size;
    uint64_t *bits;
} Room;

INLINE int64_t padded(int64_t m) { return (m + TILE - 1) / TILE * TILE; }

/* Finds a curve's columns in `values` (samples, m1) and `shapes` (samples, m2); `place` as in skinlab_grams. */
INLINE void gather(Curve *c, uint64_t *bits, int64_t m1, int64_t m2, const double *values, const double *shapes,
                   const int64_t *place) {
    memset(bits, 0, (m1 + m2) * sizeof *bits);
    for (int64_t t = 0; t < c->samples; t++) {
        const uint64_t *x = (const uint64_t *)(values + t * m1), *v = (const uint64_t *)(shapes + t * m2);
        for (int64_t i = 0; i < m1; i++) bits[i] |= x[i] << 1; /* without its sign */
        for (int64_t i = 0; i < m2; i++) bits[m1 + i] |= v[i] << 1;
    }
    c->columns = 0;
    for (int64_t kept = 0; kept < 2; kept++) {
        c->alone = c->columns;
        for (int64_t i = 0; i < m1 + m2; i++)
            if (bits[i] && (place[i] >= 0) == kept) c->place[c->columns] = place[i], c->own[c->columns++] = i;
    }
    c->width = padded(c->columns);
    memset(c->x, 0, (c->samples + 1) * c->width * sizeof *c->x);
    for (int64_t t = 0; t < c->samples; t++)
        for (int64_t j = 0; j < c->columns; j++) {
            const int64_t i = c->own[j];
            c->x[(t + 1) * c->width + j] = i < m1 ? values[t * m1 + i] : shapes[t * m2 + i - m1];
        }
}

/* Adds products of four columns, `rows`, with 4 * many others over so many samples. */
INLINE void add_tile(const int64_t many, int64_t samples, int64_t width, const double *rows, const double *others,
                     double *to) {
    Four s[4][3], y[3];
    for (int64_t i = 0; i < 4; i++)
        for (int64_t j = 0; j < many; j++) s[i][j] = load4(to + i * width + 4 * j);
    for (int64_t k = 0; k < samples; k++, rows += width, others += width) {
        for (int64_t j = 0; j < many; j++) y[j] = load4(others + 4 * j);
        for (int64_t i = 0; i < 4; i++)
            for (int64_t j = 0; j < many; j++) s[i][j] += rows[i] * y[j];
    }
    for (int64_t i = 0; i < 4; i++)
        for (int64_t j = 0; j < many; j++) *(Four *)(to + i * width + 4 * j) = s[i][j];
}

/* (W x)' (W x) of a curve into `gram` (width, width), its lower triangle, and the log determinant: see
 * skinlab_grams. Returns whether it failed. */
INLINE int64_t gram_of(const Curve *c, const Room *room, const double *variance, double square, const double *decay,
                       double *log_determinant) {
    const int64_t width = c->width;
    double before = 0.0, inverse = 0.0, product = 1.0, total = 0.0, *last = room->last, *gram = room->gram;
    memset(gram, 0, width * width * sizeof *gram);
    memset(last, 0, width * sizeof *last);
    for (int64_t first = 0; first < c->samples; first += ROWS) {
        const int64_t count = c->samples - first < ROWS ? c->samples - first : ROWS;
        const double *x = c->x + first * width;
        double phi[ROWS] = {0}, below[ROWS] = {0}, root[ROWS];
        for (int64_t k = 0; k < count; k++) {
            const int64_t t = first + k;
            double pivot = variance[t];
            if (decay) {
                const double beside = -decay[t] * before;
                phi[k] = decay[t], below[k] = beside * inverse;
                pivot += square * (1.0 - phi[k] * phi[k]) + phi[k] * phi[k] * before - below[k] * beside;
                before = variance[t];
            }
            if (!(pivot > 0.0)) return 1;
            root[k] = inverse = 1.0 / pivot;
            /* Four of mm² at a time stay within a double's range; a logarithm is slow. */
            product *= pivot;
            if (t % 4 == 3) {
                total += log(product);
                product = 1.0;
            }
        }
        for (int64_t k = 0; k < count; k++) root[k] = sqrt(root[k]);
        for (int64_t b = 0; b < width; b += TILE) {
            Four x0 = load4(x + b), x1 = load4(x + b + 4), w0 = load4(last + b), w1 = load4(last + b + 4);
            for (int64_t k = 0; k < count; k++) {
                const double *here = x + (k + 1) * width + b;
                double *white = room->white + k * width + b;
                w0 = load4(here) - phi[k] * x0 - below[k] * w0, x0 = load4(here);
                w1 = load4(here + 4) - phi[k] * x1 - below[k] * w1, x1 = load4(here + 4);
                *(Four *)white = root[k] * w0, *(Four *)(white + 4) = root[k] * w1;
            }
            *(Four *)(last + b) = w0, *(Four *)(last + b + 4) = w1;
        }
        for (int64_t a = 0; a < c->columns; a += 4) {
            const double *rows = room->white + a;
            double *to = gram + a * width;
            int64_t b = 0;
            for (; b + 12 <= a + 4; b += 12) add_tile(3, count, width, rows, room->white + b, to + b);
            if (b + 8 == a + 4) add_tile(2, count, width, rows, room->white + b, to + b);
            if (b == a) add_tile(1, count, width, rows, room->white + b, to + b);
        }
    }
    *log_determinant = total + log(product);
    return 0;
}

/* Adds what `gram_of` found, its columns times `sizes` (m2) if any, to one matrix's lower triangle. Returns
 * whether it failed. */
INLINE int64_t add_integrated(const Curve *c, const Room *room, int64_t m1, const double *sizes, int64_t width,
                              double *whole, double *log_determinant) {
    double *size = room->size, *row = room->row;
    for (int64_t r = 0; r < c->columns; r++) size[r] = sizes && c->own[r] >= m1 ? sizes[c->own[r] - m1] : 1.0;
    for (int64_t r = 0; r < c->columns; r++) {
        for (int64_t s = 0; s <= r; s++) row[s] = room->gram[r * c->width + s] * size[r] * size[s];
        for (int64_t k = 0; k < r && k < c->alone; k++) {
            double *taken = room->taken + k * c->width;
            const double factor = row[k] * room->inverse[k];
            taken[r] = row[k];
            for (int64_t s = k + 1; s <= r; s++) row[s] -= factor * taken[s];
        }
        if (r < c->alone) {
            const double pivot = row[r] + 1.0;
            if (!(pivot > 0.0)) return 1;
            room->inverse[r] = 1.0 / pivot;
            *log_determinant += log(pivot);
        } else {
            double *to = whole + c->place[r] * width;
            for (int64_t s = c->alone; s <= r; s++) to[c->place[s]] += row[s];
        }
    }
    return 0;
}

/* Adds (W x)' (W x) of x = [values, shapes times their sizes] to `whole` (many, width, width) for `many`
 * covariances of the same samples, curve by curve, and the log determinants: W'W is the inverse of D + B, with
 * D `variance` (different, n) and B an Ornstein-Uhlenbeck process of variance `square` (different), none where
 * that is null; `decay` (different, n) is its correlation with the sample before, 0 where a curve begins.
 * `values` (n, m1), `shapes` (different) of (n, m2); `ends` (curves). `which` of those different each has, and
 * `sizes` (many, m2) if any. `place` (m1 + m2) is where a column stands in `whole`; one below 0 is of one curve
 * alone, independent and of variance 1: it is integrated out; the others ascend. Returns 0, 1 where one is not
 * positive definite, or -1 where there is no room. */
FAST int64_t skinlab_grams(int64_t many, int64_t different, int64_t curves, const int64_t *ends, int64_t m1,
                           int64_t m2, const double *values, const double *const *shapes, const double *variance,
                           const double *square, const double *decay, const int64_t *which, const double *sizes,
                           const int64_t *place, int64_t width, double *whole, double *log_determinant) {
    const int64_t m = m1 + m2, wide = padded(m), n = ends[curves - 1];
    Curve *all = malloc(curves * sizeof *all);
    double *reals = malloc((n + curves + ROWS + 2 * wide + 4) * wide * sizeof *reals);
    int64_t *integers = malloc((2 * curves + 1) * m * sizeof *integers), failed = 0;
    if (!all || !reals || !integers) failed = -1;
    Room room = {.white = reals + (n + curves) * wide, .bits = (uint64_t *)(integers + 2 * curves * m)};
    room.gram = room.white + ROWS * wide, room.taken = room.gram + wide * wide;
    room.inverse = room.taken + wide * wide, room.last = room.inverse + wide;
    room.row = room.last + wide, room.size = room.row + wide;
    for (int64_t i = 0, begin = 0; i < curves && !failed; begin = ends[i++]) {
        all[i] = (Curve){.begin = begin, .samples = ends[i] - begin, .x = reals + (begin + i) * wide};
        all[i].own = integers + 2 * i * m, all[i].place = all[i].own + m;
    }
    for (int64_t d = 0; d < different && !failed; d++)
        for (Curve *c = all; c < all + curves && !failed; c++) {
            const int64_t row = d * n + c->begin;
            double log_base;
            if (!d || shapes[d] != shapes[d - 1])
                gather(c, room.bits, m1, m2, values + c->begin * m1, shapes[d] + c->begin * m2, place);
            failed = gram_of(c, &room, variance + row, square ? square[d] : 0.0, decay ? decay + row : NULL, &log_base);
            for (int64_t i = 0; i < many && !failed; i++)
                if (which[i] == d) {
                    log_determinant[i] += log_base;
                    failed = add_integrated(c, &room, m1, sizes ? sizes + i * m2 : NULL, width,
                                            whole + i * width * width, log_determinant + i);
                }
        }
    for (double *one = whole; one < whole + many * width * width; one += width * width)
        for (int64_t r = 0; r < width; r++)
            for (int64_t s = 0; s < r; s++) one[s * width + r] = one[r * width + s];
    free(all), free(reals), free(integers);
    return failed;
}
