/* The floor: a hand-written stepper for the one problem of the benchmark.
 *
 * The thesis's actuator, deflection state, no feedback, under a forward sawtooth from rest.
 * Lengths in um.  State: d = y - x_e, v = d', platform y and w = y', bristle z.  Taylor
 * series in each mode, v > 0, v < 0 or stuck; the end of a mode is a root of a polynomial.
 * Once all deviations are below `rest`, the remainder of the ramp is analytic.
 *
 * Sensitivities are with respect to the logarithms of the ten parameters.  Where v passes
 * through 0 only v' jumps, so that dv/dp is multiplied by v'(after)/v'(before).
 */
#include <string.h>
#include <tgmath.h>

#ifndef REAL
#define REAL double
#endif
typedef REAL real;

enum { D, V, Y, W, Z, STATES };
enum { RATE, DAMPING, GAIN, MASS, S0, S1 = 6, FSS = 8, PARAMETERS = 10 };
enum { MAX_ORDER = 30, MAX_STEPS = 1000000, SAMPLES_OF_A_STEP = 6 };

typedef struct {
    real rate, damping, gain, mass, s0[2], s1[2], fss[2];
} Model;

typedef struct {
    real x[STATES], s[STATES][PARAMETERS];
    int mode;
} State;

typedef struct {
    real x[STATES][MAX_ORDER + 1], s[STATES][MAX_ORDER + 1][PARAMETERS];
} Series;

static real horner(const real *c, int order, real h) {
    real total = c[order];
    for (int k = order - 1; k >= 0; k--) total = total * h + c[k];
    return total;
}

static real push(const Model *m, const real *x, real u) {
    return m->rate * (m->rate * (m->gain * u - x[Y]) - 2 * m->damping * x[W]);
}

/* v' on the side `mode` of v = 0 */
static real relative(const Model *m, const State *at, real u, int mode) {
    return push(m, at->x, u) - m->s0[mode < 0] * at->x[Z] / m->mass;
}

static void expand(const Model *m, const State *at, real u, real slope, int order, int sensitive, Series *out) {
    const int b = at->mode < 0, moves = at->mode != 0;
    const real a = m->rate * m->rate, c = 2 * m->damping * m->rate, kappa = at->mode * m->s0[b] / m->fss[b];
    const real g = a * m->gain, light = 1 / m->mass;
    real(*x)[MAX_ORDER + 1] = out->x;
    for (int i = 0; i < STATES; i++) x[i][0] = at->x[i];
    if (sensitive)
        for (int i = 0; i < STATES; i++) memcpy(out->s[i][0], at->s[i], sizeof at->s[i]);
    for (int k = 0; k < order; k++) {
        const real over = (real)1 / (k + 1), drive = k == 0 ? g * u : k == 1 ? g * slope : 0;
        const real free = drive - a * x[Y][k] - c * x[W][k];
        real product = 0, flow = 0, force = 0;
        x[Y][k + 1] = x[W][k] * over;
        x[W][k + 1] = free * over;
        if (moves) {
            for (int i = 0; i <= k; i++) product += x[V][i] * x[Z][k - i];
            flow = x[V][k] - kappa * product;
            force = m->s0[b] * x[Z][k] + m->s1[b] * flow;
        }
        x[D][k + 1] = moves ? x[V][k] * over : 0;
        x[V][k + 1] = moves ? (free - force * light) * over : 0;
        x[Z][k + 1] = flow * over;
        if (!sensitive) continue;

        real free_p[PARAMETERS], product_p[PARAMETERS] = {0}, flow_p[PARAMETERS], force_p[PARAMETERS];
        for (int p = 0; p < PARAMETERS; p++) free_p[p] = -a * out->s[Y][k][p] - c * out->s[W][k][p];
        free_p[RATE] += 2 * drive - 2 * a * x[Y][k] - c * x[W][k];
        free_p[DAMPING] -= c * x[W][k];
        free_p[GAIN] += drive;
        for (int p = 0; p < PARAMETERS; p++) {
            out->s[Y][k + 1][p] = out->s[W][k][p] * over;
            out->s[W][k + 1][p] = free_p[p] * over;
        }
        if (!moves) {
            for (int i = 0; i < STATES; i++)
                if (i != Y && i != W) memset(out->s[i][k + 1], 0, sizeof out->s[i][k + 1]);
            continue;
        }
        for (int i = 0; i <= k; i++)
            for (int p = 0; p < PARAMETERS; p++)
                product_p[p] += out->s[V][i][p] * x[Z][k - i] + x[V][i] * out->s[Z][k - i][p];
        for (int p = 0; p < PARAMETERS; p++) flow_p[p] = out->s[V][k][p] - kappa * product_p[p];
        flow_p[S0 + b] -= kappa * product;
        flow_p[FSS + b] += kappa * product;
        for (int p = 0; p < PARAMETERS; p++) force_p[p] = m->s0[b] * out->s[Z][k][p] + m->s1[b] * flow_p[p];
        force_p[S0 + b] += m->s0[b] * x[Z][k];
        force_p[S1 + b] += m->s1[b] * flow;
        force_p[MASS] -= force;
        for (int p = 0; p < PARAMETERS; p++) {
            out->s[D][k + 1][p] = out->s[V][k][p] * over;
            out->s[Z][k + 1][p] = flow_p[p] * over;
            out->s[V][k + 1][p] = (free_p[p] - force_p[p] * light) * over;
        }
    }
}

/* A. Jorba and M. Zou, Experimental Mathematics 14(1), 2005 */
static real reach_of(const Model *m, const Series *c, int order, real tolerance) {
    const real units[STATES] = {1, 1 / m->rate, 1, 1 / m->rate, 1};
    real reach = INFINITY;
    for (int k = order - 1; k <= order; k++) {
        real largest = 1e-300;
        for (int i = 0; i < STATES; i++) largest = fmax(largest, fabs(c->x[i][k]) * units[i]);
        reach = fmin(reach, exp(log(largest / tolerance) / -k));
    }
    return (real)0.95 * reach;
}

/* The first h in (0, reach] at which c, positive before, falls below 0; -1 where it does not. */
static real first_root(const real *c, int order, real reach) {
    real low = 0, high = -1;
    for (int i = 1; i <= SAMPLES_OF_A_STEP && high < 0; i++) {
        const real h = reach * i / SAMPLES_OF_A_STEP;
        if (horner(c, order, h) < 0) high = h;
        else low = h;
    }
    if (high < 0) return -1;
    real h = (low + high) / 2;
    for (int i = 0; i < 60; i++) {
        real value = c[order], slope = 0;
        for (int k = order - 1; k >= 0; k--) {
            slope = slope * h + value;
            value = value * h + c[k];
        }
        if (value >= 0) low = h;
        else high = h;
        real next = h - value / slope;
        if (!(next > low && next < high)) next = (low + high) / 2;
        const real moved = fabs(next - h);
        h = next;
        if (moved <= 4e-16 * reach) break;
    }
    return h;
}

/* Where the mode ends within `reach`, or -1.  `guard` 1: it lets go to v > 0, -1: to v < 0. */
static real event(const Model *m, const State *at, const Series *c, real u, real slope, int order, real reach, int *guard) {
    real g[MAX_ORDER + 1], first = -1;
    if (at->mode != 0) {
        const int fresh = at->x[V] * at->mode <= 0; /* starts at the last root: divide it out */
        for (int k = 0; k + fresh <= order; k++) g[k] = at->mode * c->x[V][k + fresh];
        *guard = 0;
        return first_root(g, order - fresh, reach);
    }
    for (int side = 1; side >= -1; side -= 2) {
        for (int k = 0; k < order; k++) { /* the held force is m y'' */
            const real free = (k + 1) * c->x[W][k + 1];
            g[k] = side * ((k == 0 ? m->s0[side < 0] * at->x[Z] : 0) - m->mass * free);
        }
        const real h = first_root(g, order - 1, reach);
        if (h >= 0 && (first < 0 || h < first)) {
            first = h;
            *guard = side;
        }
    }
    return first;
}

/* Filippov's rule at v = 0 */
static int mode_at_rest(const Model *m, const State *at, real u, int came) {
    const int forward = relative(m, at, u, 1) > 0, backward = relative(m, at, u, -1) < 0;
    if (forward && backward) return came ? -came : 1;
    return forward ? 1 : backward ? -1 : 0;
}

static void pass_zero(const Model *m, State *at, real u, int guard, int sensitive) {
    const int came = at->mode;
    at->x[V] = 0;
    at->mode = came ? mode_at_rest(m, at, u, came) : guard;
    if (!sensitive || !came) return;
    const real before = relative(m, at, u, came), after = at->mode ? relative(m, at, u, at->mode) : 0;
    for (int p = 0; p < PARAMETERS; p++) at->s[V][p] *= after / before;
}

/* The steady platform and its sensitivities, x[Y] and x[W]. */
static void steady(const Model *m, real u, real slope, State *out) {
    const real lag = 2 * m->damping / m->rate * slope;
    memset(out, 0, sizeof *out);
    out->x[Y] = m->gain * (u - lag);
    out->x[W] = m->gain * slope;
    out->s[Y][RATE] = m->gain * lag;
    out->s[Y][DAMPING] = -m->gain * lag;
    out->s[Y][GAIN] = out->x[Y];
    out->s[W][GAIN] = out->x[W];
}

static int is_settled(const Model *m, const State *at, const State *ramp, real rest, int sensitive) {
    const real slow = 1 / m->rate;
    const real units[STATES] = {0, slow, 1, slow, 1};
    for (int i = V; i < STATES; i++) {
        if (fabs(at->x[i] - ramp->x[i]) * units[i] >= rest) return 0;
        for (int p = 0; sensitive && p < PARAMETERS; p++)
            if (fabs(at->s[i][p] - ramp->s[i][p]) * units[i] >= 10 * rest) return 0;
    }
    return 1;
}

/* Samples of x_e on the analytic ramp, and the state at its end. */
static void settle(const Model *m, State *at, real slope, real origin, real end, const double *times, int count,
                   int *next, double *out, double *jacobian) {
    State ramp;
    const real d = at->x[D] - at->x[Z];
    real d_p[PARAMETERS];
    for (int p = 0; p < PARAMETERS; p++) d_p[p] = at->s[D][p] - at->s[Z][p];
    for (; *next < count && times[*next] <= origin + end; ++*next) {
        steady(m, slope * (times[*next] - origin), slope, &ramp);
        out[*next] = ramp.x[Y] - d;
        for (int p = 0; jacobian && p < PARAMETERS; p++) jacobian[*next * PARAMETERS + p] = ramp.s[Y][p] - d_p[p];
    }
    steady(m, slope * end, slope, at);
    at->x[D] = d;
    memcpy(at->s[D], d_p, sizeof d_p);
}

/* x_e [um] at `times`, shape (count,), and its Jacobian, shape (count, 10), where wanted.
 * Returns the number of steps, or -1 where they do not suffice. */
int simulate(const double *p, double volts, double frequency, int cycles, const double *times, int count,
             double tolerance, double rest, int order, double *out, double *jacobian) {
    const Model m = {p[0], p[1], 1e6L * p[2], p[3], {p[4], p[5]}, {p[6], p[7]}, {1e6L * p[8], 1e6L * p[9]}};
    const real period = (real)1 / frequency, slope = volts * (real)frequency;
    static _Thread_local Series c;
    State at = {.mode = 1}, ramp;
    int steps = 0, next = 0, guard;
    for (int cycle = 0; cycle < cycles; cycle++) {
        const real origin = cycle * period;
        /* the last sample of a cycle may lie on the drop, up to rounding */
        const real until = period * (1 + (real)1e-13);
        real after = 0;
        if (at.mode == 0 || cycle == 0) at.mode = cycle ? mode_at_rest(&m, &at, 0, 0) : 1;
        while (after < period) {
            if (next == count) return steps;
            const real u = slope * after;
            steady(&m, u, slope, &ramp);
            if (steps > 0 && is_settled(&m, &at, &ramp, rest, jacobian != 0)) {
                settle(&m, &at, slope, origin, until, times, count, &next, out, jacobian);
                break;
            }
            if (++steps > MAX_STEPS) return -1;
            expand(&m, &at, u, slope, order, jacobian != 0, &c);
            real h = fmin(reach_of(&m, &c, order, tolerance), period - after);
            const real root = event(&m, &at, &c, u, slope, order, h, &guard);
            const int last = root < 0 && h >= period - after;
            if (root >= 0) h = root;
            for (; next < count && times[next] <= origin + (last ? until : after + h); next++) {
                const real lapse = times[next] - origin - after;
                out[next] = horner(c.x[Y], order, lapse) - horner(c.x[D], order, lapse);
                if (!jacobian) continue;
                double *row = jacobian + next * PARAMETERS;
                real moved[PARAMETERS] = {0};
                for (int k = order; k >= 0; k--)
                    for (int q = 0; q < PARAMETERS; q++)
                        moved[q] = moved[q] * lapse + (c.s[Y][k][q] - c.s[D][k][q]);
                for (int q = 0; q < PARAMETERS; q++) row[q] = moved[q];
            }
            for (int i = 0; i < STATES; i++) {
                at.x[i] = horner(c.x[i], order, h);
                if (!jacobian) continue;
                for (int q = 0; q < PARAMETERS; q++) at.s[i][q] = c.s[i][order][q];
                for (int k = order - 1; k >= 0; k--)
                    for (int q = 0; q < PARAMETERS; q++) at.s[i][q] = at.s[i][q] * h + c.s[i][k][q];
            }
            after = last ? period : after + h;
            if (root >= 0) pass_zero(&m, &at, slope * after, guard, jacobian != 0);
        }
    }
    return steps;
}

/* x_e [um] of every point of a sweep at its own `times`, both of shape (points, count).
 * Returns the number of steps, or -1 where they do not suffice for some point. */
long sweep(const double *p, const double *volts, const double *frequency, int points, int cycles, const double *times,
           int count, double tolerance, double rest, int order, double *out) {
    long steps = 0;
    for (int i = 0; i < points; i++) {
        const long at = (long)i * count;
        const int taken = simulate(p, volts[i], frequency[i], cycles, times + at, count, tolerance, rest, order,
                                   out + at, NULL);
        if (taken < 0) return -1;
        steps += taken;
    }
    return steps;
}
