// The step of hex8 and hex8-stiffness in C++: forces, update and energy ledger, as studies/benchmarks/peer_cpp.py calls it.
//
// LANES elements are computed at once, in vectors of the compiler (GCC or Clang). What an element is comes in two ways, and the
// benchmark takes the faster one at each size: READ, 31 numbers of each element and those of its hourglass treatment, as the package
// stores them; or DERIVED from the reference positions of its nodes at each step, which moves 256 to 320 bytes an element less
// and takes a fifth more operations. In a second cache the former is faster, in memory the latter. Updating each node just before
// the first element that needs it, in one sweep, was not faster: the second sweep reads what lies one after the other.
//
// The formulas and their sources stand in explicitfe/elements and explicitfe/materials; names here are the same.

#include <cstddef>
#include <cstdint>
#ifdef __AVX512F__
#include <immintrin.h>
#endif

namespace {

constexpr int READ = 31;              // b (6 x 3), hX (4 x 3), volume
constexpr double THIRD = 1.0 / 3.0;
constexpr double CUBE_ROOT_START = 4.0 / 3.0;

typedef double vec __attribute__((vector_size(8 * LANES)));
typedef double loose_vec __attribute__((vector_size(8 * LANES), aligned(8)));
typedef int64_t bits __attribute__((vector_size(8 * LANES)));
typedef double row __attribute__((vector_size(32)));  // of a node: x, y, z, 0
typedef double loose_row __attribute__((vector_size(32), aligned(8)));

#define INLINE inline __attribute__((always_inline))
#define PICK __builtin_shufflevector
#ifdef __clang__
#define UNROLLED _Pragma("unroll")
#else
#define UNROLLED _Pragma("GCC unroll 8")
#endif

INLINE vec load(const double* from) { return *reinterpret_cast<const loose_vec*>(from); }
INLINE void store(double* to, vec value) { *reinterpret_cast<loose_vec*>(to) = value; }
// nodes are told by where their rows begin, as in the package: 4 times their number
INLINE row load_row(const double* rows, uint32_t node) { return *reinterpret_cast<const loose_row*>(rows + node); }
INLINE void add_row(double* rows, uint32_t node, row value) {
    double* to = rows + node;
    *reinterpret_cast<loose_row*>(to) = value + *reinterpret_cast<loose_row*>(to);
}

// ---- node rows into lanes and back: shuffles of whole registers ----

#if LANES == 8
INLINE vec side_by_side(row a, row b) {
#ifdef __AVX512F__  // an insertion from memory; GCC would shuffle registers
    return _mm512_insertf64x4(_mm512_castpd256_pd512(a), b, 1);
#else
    return PICK(a, b, 0, 1, 2, 3, 4, 5, 6, 7);
#endif
}
#endif

INLINE void gather(const double* rows, const uint32_t* nodes, vec& x, vec& y, vec& z) {
    row r[LANES];
    for (int lane = 0; lane < LANES; lane++) r[lane] = load_row(rows, nodes[lane]);
#if LANES == 8
    const vec a = side_by_side(r[0], r[2]), b = side_by_side(r[1], r[3]), c = side_by_side(r[4], r[6]), d = side_by_side(r[5], r[7]);
    const vec xz_low = PICK(a, b, 0, 8, 2, 10, 4, 12, 6, 14), xz_top = PICK(c, d, 0, 8, 2, 10, 4, 12, 6, 14);
    const vec y_low = PICK(a, b, 1, 9, 3, 11, 5, 13, 7, 15), y_top = PICK(c, d, 1, 9, 3, 11, 5, 13, 7, 15);
    x = PICK(xz_low, xz_top, 0, 1, 4, 5, 8, 9, 12, 13);
    y = PICK(y_low, y_top, 0, 1, 4, 5, 8, 9, 12, 13);
    z = PICK(xz_low, xz_top, 2, 3, 6, 7, 10, 11, 14, 15);
#elif LANES == 4
    const vec xz_low = PICK(r[0], r[1], 0, 4, 2, 6), xz_top = PICK(r[2], r[3], 0, 4, 2, 6);
    const vec y_low = PICK(r[0], r[1], 1, 5, 3, 7), y_top = PICK(r[2], r[3], 1, 5, 3, 7);
    x = PICK(xz_low, xz_top, 0, 1, 4, 5);
    y = PICK(y_low, y_top, 0, 1, 4, 5);
    z = PICK(xz_low, xz_top, 2, 3, 6, 7);
#else
    x = PICK(r[0], r[1], 0, 4), y = PICK(r[0], r[1], 1, 5), z = PICK(r[0], r[1], 2, 6);
#endif
}

INLINE void add(double* rows, const uint32_t* nodes, vec x, vec y, vec z) {
#if LANES == 8
    const vec none = {0, 0, 0, 0, 0, 0, 0, 0};
    const vec xy02 = PICK(x, y, 0, 8, 2, 10, 4, 12, 6, 14), xy13 = PICK(x, y, 1, 9, 3, 11, 5, 13, 7, 15);
    const vec z02 = PICK(z, none, 0, 8, 2, 10, 4, 12, 6, 14), z13 = PICK(z, none, 1, 9, 3, 11, 5, 13, 7, 15);
    const vec a = PICK(xy02, z02, 0, 1, 8, 9, 2, 3, 10, 11), b = PICK(xy13, z13, 0, 1, 8, 9, 2, 3, 10, 11);
    const vec c = PICK(xy02, z02, 4, 5, 12, 13, 6, 7, 14, 15), d = PICK(xy13, z13, 4, 5, 12, 13, 6, 7, 14, 15);
    add_row(rows, nodes[0], PICK(a, a, 0, 1, 2, 3));
    add_row(rows, nodes[1], PICK(b, b, 0, 1, 2, 3));
    add_row(rows, nodes[2], PICK(a, a, 4, 5, 6, 7));
    add_row(rows, nodes[3], PICK(b, b, 4, 5, 6, 7));
    add_row(rows, nodes[4], PICK(c, c, 0, 1, 2, 3));
    add_row(rows, nodes[5], PICK(d, d, 0, 1, 2, 3));
    add_row(rows, nodes[6], PICK(c, c, 4, 5, 6, 7));
    add_row(rows, nodes[7], PICK(d, d, 4, 5, 6, 7));
#elif LANES == 4
    const vec none = {0, 0, 0, 0};
    const vec xy02 = PICK(x, y, 0, 4, 2, 6), xy13 = PICK(x, y, 1, 5, 3, 7);
    const vec z02 = PICK(z, none, 0, 4, 2, 6), z13 = PICK(z, none, 1, 5, 3, 7);
    add_row(rows, nodes[0], PICK(xy02, z02, 0, 1, 4, 5));
    add_row(rows, nodes[1], PICK(xy13, z13, 0, 1, 4, 5));
    add_row(rows, nodes[2], PICK(xy02, z02, 2, 3, 6, 7));
    add_row(rows, nodes[3], PICK(xy13, z13, 2, 3, 6, 7));
#else
    const vec none = {0, 0};
    const row xy = PICK(x, y, 0, 2, 1, 3), z0 = PICK(z, none, 0, 2, 1, 3);
    add_row(rows, nodes[0], PICK(xy, z0, 0, 1, 4, 5));
    add_row(rows, nodes[1], PICK(xy, z0, 2, 3, 6, 7));
#endif
}

// ---- modes ----

INLINE void to_modes(const vec a[8], vec m[7]) {
    const vec s01 = a[1] + a[0], d01 = a[1] - a[0], s32 = a[2] + a[3], d32 = a[2] - a[3];
    const vec s45 = a[5] + a[4], d45 = a[5] - a[4], s76 = a[6] + a[7], d76 = a[6] - a[7];
    const vec s_low = s32 + s01, e_low = s32 - s01, d_low = d32 + d01, de_low = d32 - d01;
    const vec s_top = s76 + s45, e_top = s76 - s45, d_top = d76 + d45, de_top = d76 - d45;
    m[0] = d_top + d_low, m[1] = e_top + e_low, m[2] = s_top - s_low, m[3] = e_top - e_low;
    m[4] = d_top - d_low, m[5] = de_top + de_low, m[6] = de_top - de_low;
}

INLINE void minus_from_modes(const vec m[7], vec f[8]) {
    const vec xi_low = m[0] - m[4], xi_top = m[0] + m[4], eta_low = m[1] - m[3], eta_top = m[1] + m[3];
    const vec xe_low = m[5] - m[6], xe_top = m[5] + m[6];
    const vec p_low = xi_low + eta_low, m_low = xi_low - eta_low, p_top = xi_top + eta_top, m_top = xi_top - eta_top;
    const vec a_low = xe_low - m[2], b_low = xe_low + m[2], a_top = xe_top + m[2], b_top = xe_top - m[2];
    f[0] = p_low - a_low, f[1] = b_low - m_low, f[2] = -(a_low + p_low), f[3] = m_low + b_low;
    f[4] = p_top - a_top, f[5] = b_top - m_top, f[6] = -(a_top + p_top), f[7] = m_top + b_top;
}

INLINE void gather_modes(const double* rows, const uint32_t* nodes, vec m[3][7]) {
    vec x[8], y[8], z[8];
    UNROLLED
    for (int corner = 0; corner < 8; corner++) gather(rows, nodes + corner * LANES, x[corner], y[corner], z[corner]);
    to_modes(x, m[0]), to_modes(y, m[1]), to_modes(z, m[2]);
}

// ---- what an element is ----

struct Element {
    vec b[6][3];   // mean gradients of the modes, times ``volume / scale``
    vec scale;     // 1 where b is read
    vec hX[4][3];  // hourglass modes of the shape
    vec volume;
    vec frame[3][3];  // of hex8
    vec bending;      // of hex8-stiffness: tr(B B^T) / 24
};

template <bool ASSUMED> INLINE void read(const double* numbers, Element& g) {
    for (int k = 0; k < 18; k++) g.b[k / 3][k % 3] = load(numbers + k * LANES);
    for (int k = 0; k < 12; k++) g.hX[k / 3][k % 3] = load(numbers + (18 + k) * LANES);
    g.volume = load(numbers + (READ - 1) * LANES);
    if (ASSUMED)
        for (int k = 0; k < 9; k++) g.frame[k / 3][k % 3] = load(numbers + (READ + k) * LANES);
    else
        g.bending = load(numbers + READ * LANES);
}

template <bool ASSUMED> INLINE void derive(const double* position, const uint32_t* nodes, Element& g) {
    vec m[3][7], third[3][3];  // modes of the shape by component, and a third of those of eta zeta, zeta xi, xi eta
    gather_modes(position, nodes, m);
    for (int j = 0; j < 3; j++) {
        for (int k = 0; k < 4; k++) g.hX[k][j] = m[j][3 + k];
        for (int k = 0; k < 3; k++) third[j][k] = THIRD * m[j][3 + k];
        if (ASSUMED)
            for (int i = 0; i < 3; i++) g.frame[i][j] = 0.125 * m[j][i];
    }
    // 64 V b_xi = m_eta x m_zeta + m_xieta x m_zetaxi / 3, 64 V b_etazeta = (m_zeta x m_zetaxi + m_xieta x m_eta) / 3, and so on
    for (int i = 0; i < 3; i++) {
        const int i1 = (i + 1) % 3, i2 = (i + 2) % 3;
        for (int j = 0; j < 3; j++) {
            const int p = (j + 1) % 3, q = (j + 2) % 3;
            g.b[i][j] = m[p][i1] * m[q][i2] - m[q][i1] * m[p][i2] + third[p][i2] * m[q][3 + i1] - third[q][i2] * m[p][3 + i1];
            g.b[3 + i][j] = m[p][i2] * third[q][i1] - m[q][i2] * third[p][i1] + third[p][i2] * m[q][i1] - third[q][i2] * m[p][i1];
        }
    }
    // sum_m m_x 64 V b_mx is 64 V, as the gradient of x along x is 1
    vec sum = m[0][0] * g.b[0][0];
    for (int k = 1; k < 6; k++) sum += m[0][k] * g.b[k][0];
    g.volume = sum * (1.0 / 64.0);
    g.scale = 1.0 / sum;
    if (!ASSUMED) {
        vec square = g.b[0][0] * g.b[0][0];
        for (int k = 1; k < 18; k++) square += g.b[k / 3][k % 3] * g.b[k / 3][k % 3];
        g.bending = square * (THIRD * g.scale * g.scale);
    }
}

// ---- the law and the hourglass treatments ----

INLINE vec inverse_cube_root(vec value) {  // a guess from the exponent bits, and Newton's steps
    const bits high = reinterpret_cast<bits>(value) >> 32;
    vec y = reinterpret_cast<vec>((0x553EF000LL - ((high * 0x55555556LL) >> 32)) << 32);
    const vec third = value * THIRD;
    for (int turn = 0; turn < 4; turn++) y = y * (CUBE_ROOT_START - (third * y) * (y * y));
    return y;
}

struct Law {
    double C10, C20, C30, K;
};

INLINE vec slope_of(const Law& law, vec I1) {
    const vec x = I1 - 3.0;
    return law.C10 + (2.0 * law.C20 + 3.0 * law.C30 * x) * x;
}

// r_k = V W' d delta / d q_k and the part of the stress that comes with it, V W' d delta / dF (hex8: elements/hourglass_strain.py)
INLINE vec assumed_strain(const Law& law, vec I1, const vec F[9], const vec q[3][4], const Element& g, vec r[3][4], vec Q[9]) {
    vec a[3][3], n[3];
    for (int i = 0; i < 3; i++) {
        for (int x = 0; x < 3; x++) a[i][x] = F[3 * x] * g.frame[i][0] + F[3 * x + 1] * g.frame[i][1] + F[3 * x + 2] * g.frame[i][2];
        n[i] = a[i][0] * a[i][0] + a[i][1] * a[i][1] + a[i][2] * a[i][2];
    }
    const vec n12 = n[0] * n[1], whole = 1.0 / (n12 * n[2]), last = whole * n[2];
    const vec w[3] = {last * n[1], last * n[0], whole * n12};  // 1 / n by one division
    const auto along = [&](int k, int i) { return q[0][k] * a[i][0] + q[1][k] * a[i][1] + q[2][k] * a[i][2]; };
    const vec A1 = w[1] * along(2, 1), B1 = w[2] * along(1, 2), A2 = w[0] * along(2, 0), B2 = w[2] * along(0, 2);
    const vec A3 = w[0] * along(1, 0), B3 = w[1] * along(0, 1);
    const vec t1 = along(0, 0), t2 = along(1, 1), t3 = along(2, 2), s12 = t1 + t2, s13 = t1 + t3, s23 = t2 + t3;
    const vec f1 = w[0] * along(3, 0), f2 = w[1] * along(3, 1), f3 = w[2] * along(3, 2);
    const vec w12 = last, w13 = w[0] * w[2], w23 = w[1] * w[2];
    const vec bent = A1 * A1 + B1 * B1 + A1 * B1 + A2 * A2 + B2 * B2 + A2 * B2 + A3 * A3 + B3 * B3 + A3 * B3;
    const vec twisted = s12 * s12 * w12 + s13 * s13 * w13 + s23 * s23 * w23;
    const vec delta = (1.0 / 96.0) * (2.0 * bent + 0.5 * (twisted + f1 * f1 + f2 * f2 + f3 * f3));
    const vec slope = slope_of(law, I1 + delta);
    const vec m = (1.0 / 96.0) * g.volume * slope;

    const vec x3 = m * (4.0 * A3 + 2.0 * B3), y3 = m * (4.0 * B3 + 2.0 * A3), x2 = m * (4.0 * A2 + 2.0 * B2);
    const vec y2 = m * (4.0 * B2 + 2.0 * A2), x1 = m * (4.0 * A1 + 2.0 * B1), y1 = m * (4.0 * B1 + 2.0 * A1);
    const vec u12 = m * w12 * s12, u13 = m * w13 * s13, u23 = m * w23 * s23;
    const vec d[4][3] = {
        {u12 + u13, y3 * w[1], y2 * w[2]},
        {x3 * w[0], u12 + u23, y1 * w[2]},
        {x2 * w[0], x1 * w[1], u13 + u23},
        {m * w[0] * f1, m * w[1] * f2, m * w[2] * f3},
    };
    const vec l[3] = {
        -w[0] * (2.0 * (x3 * A3 + x2 * A2 + m * f1 * f1) + u12 * s12 + u13 * s13),
        -w[1] * (2.0 * (y3 * B3 + x1 * A1 + m * f2 * f2) + u12 * s12 + u23 * s23),
        -w[2] * (2.0 * (y2 * B2 + y1 * B1 + m * f3 * f3) + u13 * s13 + u23 * s23),
    };
    for (int x = 0; x < 3; x++) {
        for (int k = 0; k < 4; k++) r[x][k] = d[k][0] * a[0][x] + d[k][1] * a[1][x] + d[k][2] * a[2][x];
        vec b[3];
        for (int i = 0; i < 3; i++)
            b[i] = d[0][i] * q[x][0] + d[1][i] * q[x][1] + d[2][i] * q[x][2] + d[3][i] * q[x][3] + l[i] * a[i][x];
        for (int j = 0; j < 3; j++) Q[3 * x + j] = b[0] * g.frame[0][j] + b[1] * g.frame[1][j] + b[2] * g.frame[2][j];
    }
    return slope;
}

// the same of hex8-stiffness (elements/hourglass_stiffness.py), whose delta does not depend on F
INLINE vec plain_stiffness(const Law& law, vec I1, const vec q[3][4], const Element& g, vec r[3][4]) {
    vec square = q[0][0] * q[0][0];
    for (int k = 1; k < 12; k++) square += q[k / 4][k % 4] * q[k / 4][k % 4];
    const vec slope = slope_of(law, I1 + g.bending * square);
    const vec stiffness = 2.0 * g.bending * (g.volume * slope);
    for (int k = 0; k < 12; k++) r[k / 4][k % 4] = stiffness * q[k / 4][k % 4];
    return slope;
}

// minus the forces of LANES elements to the node rows; J, or NaN where the force is not finite
template <bool ASSUMED> INLINE vec add_forces(const Law& law, const Element& g, const double* u, double* force, const uint32_t* nodes) {
    vec modes[3][7], F[9], q[3][4];
    gather_modes(u, nodes, modes);
    for (int i = 0; i < 3; i++) {
        vec h[3];
        for (int j = 0; j < 3; j++) {
            h[j] = modes[i][0] * g.b[0][j];
            for (int k = 1; k < 6; k++) h[j] += modes[i][k] * g.b[k][j];
            h[j] *= g.scale;
            F[3 * i + j] = i == j ? h[j] + 1.0 : h[j];
        }
        for (int k = 0; k < 4; k++) q[i][k] = modes[i][3 + k] - h[0] * g.hX[k][0] - h[1] * g.hX[k][1] - h[2] * g.hX[k][2];
    }
    const vec cof[9] = {
        F[4] * F[8] - F[5] * F[7], F[5] * F[6] - F[3] * F[8], F[3] * F[7] - F[4] * F[6],
        F[2] * F[7] - F[1] * F[8], F[0] * F[8] - F[2] * F[6], F[1] * F[6] - F[0] * F[7],
        F[1] * F[5] - F[2] * F[4], F[2] * F[3] - F[0] * F[5], F[0] * F[4] - F[1] * F[3],
    };
    const vec J = F[0] * cof[0] + F[1] * cof[1] + F[2] * cof[2];
    const vec root = inverse_cube_root(J), square = root * root, inverse = square * root;
    vec trace = F[0] * F[0];
    for (int k = 1; k < 9; k++) trace += F[k] * F[k];
    const vec I1 = trace * square;

    vec r[3][4], Q[9];
    const vec slope = ASSUMED ? assumed_strain(law, I1, F, q, g, r, Q) : plain_stiffness(law, I1, q, g, r);
    const vec on_F = g.volume * (2.0 * slope * square);
    const vec on_cof = g.volume * (0.5 * law.K * (J - inverse) - 2.0 * THIRD * slope * I1 * inverse);

    vec f[3][8];
    for (int i = 0; i < 3; i++) {
        vec S[3], m[7];
        for (int j = 0; j < 3; j++) {
            S[j] = on_F * F[3 * i + j] + on_cof * cof[3 * i + j];
            if (ASSUMED) S[j] += Q[3 * i + j];
            for (int k = 0; k < 4; k++) S[j] -= r[i][k] * g.hX[k][j];
            S[j] *= g.scale;
        }
        for (int k = 0; k < 3; k++) m[k] = S[0] * g.b[k][0] + S[1] * g.b[k][1] + S[2] * g.b[k][2];
        for (int k = 3; k < 6; k++) m[k] = r[i][k - 3] + S[0] * g.b[k][0] + S[1] * g.b[k][1] + S[2] * g.b[k][2];
        m[6] = r[i][3];
        minus_from_modes(m, f[i]);
    }
    UNROLLED
    for (int corner = 0; corner < 8; corner++) add(force, nodes + corner * LANES, f[0][corner], f[1][corner], f[2][corner]);
    return J + 0.0 * (f[0][0] + f[1][0] + f[2][0]);
}

}  // namespace

// ---- steps ----

extern "C" struct Body {
    int64_t blocks, entries;  // of LANES elements; of the node rows, 4 a row
    double *u, *v, *force;    // as State of the package
    const double* weight;     // 1/m, 1/m, 1/m (0 where held), m
    const double* position;   // reference positions, for DERIVED
    const double* numbers;    // of the elements, for READ
    const uint32_t* nodes;
    Law law;
    double keep, gain, dt, alpha;
    double damping_loss, smallest_J;  // changed
};

namespace {

// velocities and displacements of the next instant; gives the sum of m (v- + v+)^2
double update(const Body& body) {
    vec sum{};
    for (int64_t at = 0; at < body.entries; at += LANES) {
        const vec weight = load(body.weight + at), old = load(body.v + at);
        const vec now = body.keep * old + body.gain * weight * load(body.force + at);
        store(body.v + at, now);
        store(body.u + at, load(body.u + at) + body.dt * now);
        store(body.force + at, vec{});
#if LANES == 8
        const vec mass = PICK(weight, weight, 3, 3, 3, 3, 7, 7, 7, 7);
#elif LANES == 4
        const vec mass = PICK(weight, weight, 3, 3, 3, 3);
#else
        const double m = body.weight[at / 4 * 4 + 3];
        const vec mass = {m, m};
#endif
        sum += mass * ((old + now) * (old + now));
    }
    double total = 0.0;
    for (int lane = 0; lane < LANES; lane++) total += sum[lane];
    return total;
}

template <bool ASSUMED, bool DERIVED> void advance(Body& body, int64_t steps) {
    constexpr int NUMBERS = READ + (ASSUMED ? 9 : 1);
    double squares = 0.0;
    vec smallest = body.smallest_J - vec{};
    for (int64_t step = 0; step < steps; step++) {
        squares += update(body);
        for (int64_t block = 0; block < body.blocks; block++) {
            const uint32_t* nodes = body.nodes + block * 8 * LANES;
            Element g;
            if (DERIVED) {
                derive<ASSUMED>(body.position, nodes, g);
            } else {
                read<ASSUMED>(body.numbers + block * NUMBERS * LANES, g);
                g.scale = 1.0 - vec{};
            }
            const vec J = add_forces<ASSUMED>(body.law, g, body.u, body.force, nodes);
            smallest = ((J >= smallest) | (smallest != smallest)) ? smallest : J;  // NaN stays
        }
    }
    body.damping_loss += 0.25 * body.alpha * body.dt * squares;
    for (int lane = 0; lane < LANES; lane++)
        if (!(smallest[lane] >= body.smallest_J)) body.smallest_J = smallest[lane];
}

}  // namespace

extern "C" {
void hex8_read(Body* body, int64_t steps) { advance<true, false>(*body, steps); }
void hex8_derived(Body* body, int64_t steps) { advance<true, true>(*body, steps); }
void hex8_stiffness_read(Body* body, int64_t steps) { advance<false, false>(*body, steps); }
void hex8_stiffness_derived(Body* body, int64_t steps) { advance<false, true>(*body, steps); }
}
