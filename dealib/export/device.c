/* A device as an FMU (FMI 2.0, co-simulation), made by dealib. SI units throughout.

   Forces and charges are derivatives of one energy: the piecewise cubic function of tables.h and the
   energy of Maxwell branches at a few points of the device. At each point a branch has dealib's own
   law: it stores G/2 (tr(C A) - 3), and either C_i = A^-1 follows dC_i/dt = (C - tr(C A)/3 C_i)/tau,
   or A does (a network): dA/dt = (C^-1 - A)/tau. Beyond the tables forces go on as straight lines.
   A port that is driven by its force moves by its mass and damping (velocity Verlet). */

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "tables.h"

/* --- what of FMI 2.0 is needed ---------------------------------------------------------------- */

typedef enum { OK, WARNING, DISCARD, ERROR, FATAL, PENDING } Status;
typedef void (*Logger)(void *, const char *, Status, const char *, const char *, ...);
typedef struct {
  Logger log;
  void *(*allocate)(size_t, size_t);
  void (*release)(void *);
  void (*finished)(void *, Status);
  void *environment;
} Callbacks;
typedef const unsigned *References;
#define FMI __attribute__((visibility("default")))

/* --- state ------------------------------------------------------------------------------------ */

/* variables of an axis, at reference 8 * axis + slot; the energy stands behind the last axis */
enum { INPUT, LOAD, DUAL, AT, SPEED, MASS, DAMPING, START, SLOTS };

typedef struct {
  double v[AXES + 1][SLOTS], rate[AXES + 1][SLOTS]; /* values, and rates of inputs in a step */
  double x[AXES], speed[AXES], stiff[AXES]; /* of axes driven by their force; largest stiffness */
  double inner[NETWORKS + 1][6];            /* C_i, of networks A */
  int driven[AXES], told[AXES], begun, stale;
} State;

typedef struct {
  State s;
  Callbacks call;
  char name[256];
} Device;

static Status tell(Device *d, Status status, const char *port, const char *what) {
  const char *category = status == WARNING ? "logStatusWarning" : "logStatusError";
  char text[512]; /* not all importers fill in a format, and others take a % for one */
  snprintf(text, sizeof text, "%s%s", port, what);
  for (char *p = text; (p = strchr(p, '%')); *p = '_') continue;
  if (d->call.log) d->call.log(d->call.environment, d->name, status, category, text);
  return status;
}

/* --- tables ----------------------------------------------------------------------------------- */

typedef struct {
  double energy, slope[AXES];                       /* without branches */
  double C[POINTS + 1][6], dC[POINTS + 1][AXES][6]; /* isochoric metric and its derivatives */
} Here;

/* Cell of a value; cubic Hermite functions there (value, slope at both ends), their derivatives. */
static int basis(int a, double x, double w[4], double d[4]) {
  const double *g = GRID[a];
  int k = 0;
  while (k < COUNT[a] - 2 && x > g[k + 1]) k++;
  double h = g[k + 1] - g[k], t = (x - g[k]) / h, c = t < 0 ? 0 : t > 1 ? 1 : t, r = t - c;
  double f[4] = {1 + c * c * (2 * c - 3), c * (c - 1) * (c - 1), c * c * (3 - 2 * c),
                 c * c * (c - 1)};
  double f1[4] = {6 * c * (c - 1), 1 + c * (3 * c - 4), 6 * c * (1 - c), c * (3 * c - 2)};
  double f2[4] = {12 * c - 6, 6 * c - 4, 6 - 12 * c, 6 * c - 2};
  for (int i = 0; i < 4; i++) { /* beyond the grid parabolas: derivatives of the energy go straight */
    double size = i % 2 ? h : 1;
    w[i] = size * (f[i] + r * (f1[i] + r / 2 * f2[i]));
    d[i] = size / h * (f1[i] + r * f2[i]);
  }
  return k;
}

/* Inverse of a symmetric tensor (11, 22, 33, 12, 13, 23); returns the determinant. */
static double inverse(const double *t, double *out) {
  double of[6] = {t[1] * t[2] - t[5] * t[5], t[0] * t[2] - t[4] * t[4], t[0] * t[1] - t[3] * t[3],
                  t[4] * t[5] - t[3] * t[2], t[3] * t[5] - t[4] * t[1], t[3] * t[4] - t[0] * t[5]};
  double det = t[0] * of[0] + t[3] * of[3] + t[4] * of[4];
  for (int i = 0; i < 6; i++) out[i] = of[i] / det;
  return det;
}

static double contract(const double *a, const double *b) {
  double on = a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  return on + 2 * (a[3] * b[3] + a[4] * b[4] + a[5] * b[5]);
}

static void look(const double *x, Here *here) {
  double w[AXES][4], d[AXES][4], p[TABLES] = {0}, g[AXES][TABLES] = {{0}};
  int k[AXES];
  for (int a = 0; a < AXES; a++) k[a] = basis(a, x[a], w[a], d[a]);
  for (int i = 0; i < 1 << (2 * AXES); i++) {
    int node = 0, of = 0;
    double all = 1, by[AXES];
    for (int a = 0; a < AXES; a++) by[a] = 1;
    for (int a = 0; a < AXES; a++) {
      int j = (i >> (2 * a)) & 3;
      node = node * COUNT[a] + k[a] + j / 2;
      of = 2 * of + j % 2;
      all *= w[a][j];
      for (int b = 0; b < AXES; b++) by[b] *= a == b ? d[a][j] : w[a][j];
    }
    for (int t = 0; t < TABLES; t++) {
      double value = TABLE[node][of][t];
      p[t] += all * value;
      for (int a = 0; a < AXES; a++) g[a][t] += by[a] * value;
    }
  }
  here->energy = p[0];
  for (int a = 0; a < AXES; a++) here->slope[a] = g[a][0];
  for (int n = 0; n < POINTS; n++) {
    double A[6], C[6] = {0}; /* in a plane four components are other than zero */
    memcpy(C, p + 1 + METRIC * n, METRIC * sizeof *C);
    double q = 1 / cbrt(inverse(C, A));
    for (int i = 0; i < 6; i++) here->C[n][i] = q * C[i];
    for (int a = 0; a < AXES; a++) {
      double dC[6] = {0};
      memcpy(dC, g[a] + 1 + METRIC * n, METRIC * sizeof *dC);
      double trace = contract(A, dC) / 3;
      for (int i = 0; i < 6; i++) here->dC[n][a][i] = q * (dC[i] - trace * C[i]);
    }
  }
}

/* --- branches --------------------------------------------------------------------------------- */

/* What the inner state of a branch becomes in the long run. */
static void rest(int k, const double *C, double *out) {
  if (LINEAR[k]) inverse(C, out);
  else memcpy(out, C, 6 * sizeof *out);
}

/* One step of the branches, of second order, exact at small strain for a straight path. */
static void relax(State *s, const Here *from, const Here *to, double h) {
  for (int k = 0; k < NETWORKS; k++) {
    double A[6], B0[6], B1[6], rate = 1, *inner = s->inner[k];
    const double *C = from->C[POINT[k]];
    rest(k, C, B0);
    rest(k, to->C[POINT[k]], B1);
    if (!LINEAR[k]) {
      inverse(inner, A);
      rate = contract(C, A) / 3;
    }
    double z = rate * h / TIME[k], decay = exp(-z), mean = z < 1e-4 ? 0 : -expm1(-z) / z;
    double before = z < 1e-4 ? z / 2 - z * z / 3 : mean - decay;
    double after = z < 1e-4 ? z / 2 - z * z / 6 : 1 - mean;
    for (int i = 0; i < 6; i++) inner[i] = decay * inner[i] + (before * B0[i] + after * B1[i]) / rate;
    double q = LINEAR[k] ? 1 : 1 / cbrt(inverse(inner, A));
    for (int i = 0; i < 6; i++) inner[i] *= q;
  }
}

/* Derivatives of the energy by the axes, with branches; returns the energy. */
static double slopes(const State *s, const Here *here, double *f) {
  double energy = here->energy;
  memcpy(f, here->slope, AXES * sizeof *f);
  for (int k = 0; k < NETWORKS; k++) {
    double inverted[6], det = inverse(s->inner[k], inverted);
    const double *A = LINEAR[k] ? s->inner[k] : inverted;
    energy += MODULUS[k] / 2 * (contract(here->C[POINT[k]], A) - 3 - (LINEAR[k] ? log(det) : 0));
    for (int a = 0; a < AXES; a++) f[a] += MODULUS[k] / 2 * contract(here->dC[POINT[k]][a], A);
  }
  return energy;
}

/* --- time ------------------------------------------------------------------------------------- */

static void where(const State *s, double *x) {
  for (int a = 0; a < AXES; a++) x[a] = s->driven[a] ? s->x[a] : s->v[a][INPUT];
}

/* Start at rest, the branches relaxed. */
static void begin(State *s) {
  Here here;
  double x[AXES];
  for (int a = 0; a < AXES; a++) s->x[a] = s->v[a][START], s->speed[a] = 0;
  where(s, x);
  look(x, &here);
  for (int k = 0; k < NETWORKS; k++) rest(k, here.C[POINT[k]], s->inner[k]);
}

static void answer(State *s) {
  Here here;
  double x[AXES], f[AXES];
  if (!s->begun) begin(s);
  where(s, x);
  look(x, &here);
  s->v[AXES][0] = slopes(s, &here, f);
  for (int a = 0; a < AXES; a++) {
    s->v[a][DUAL] = SIGN[a] * f[a];
    s->v[a][AT] = x[a];
    s->v[a][SPEED] = s->speed[a];
  }
  s->stale = 0;
}

static void advance(State *s, double h) {
  Here from, to;
  double x[AXES], f[AXES], half[AXES] = {0};
  where(s, x);
  look(x, &from);
  slopes(s, &from, f);
  for (int a = 0; a < AXES; a++) {
    double m = s->v[a][MASS], c = s->v[a][DAMPING], force = s->v[a][LOAD] - f[a];
    if (s->driven[a]) half[a] = (s->speed[a] + h / 2 / m * force) / (1 + h / 2 / m * c);
    s->x[a] += h * half[a];
    for (int i = INPUT; i <= LOAD; i++) s->v[a][i] += h * s->rate[a][i];
  }
  where(s, x);
  look(x, &to);
  relax(s, &from, &to, h);
  slopes(s, &to, f);
  for (int a = 0; a < AXES; a++) {
    double m = s->v[a][MASS], c = s->v[a][DAMPING], force = s->v[a][LOAD] - f[a];
    if (s->driven[a]) s->speed[a] = half[a] * (1 - h / 2 / m * c) + h / 2 / m * force;
  }
}

/* Number of steps in h: of the branches, of inputs over the tables, of the vibration. Steps that
   change with the state would let its energy drift. */
static double steps(State *s, double h) {
  double n = 1, x[AXES], f[2][AXES], centre[AXES];
  for (int k = 0; k < NETWORKS; k++) n = fmax(n, fmin(4 * h / TIME[k], 100));
  where(s, centre);
  for (int a = 0; a < AXES; a++) {
    Here here;
    double range = GRID[a][COUNT[a] - 1] - GRID[a][0], small = 1e-4 * range;
    if (!s->driven[a]) {
      n = fmax(n, fmin(50 * h * fabs(s->rate[a][INPUT]) / range, 1e4));
      continue;
    }
    for (int side = 0; side < 2; side++) {
      memcpy(x, centre, sizeof x);
      x[a] += side ? small : -small;
      look(x, &here);
      slopes(s, &here, f[side]);
    }
    s->stiff[a] = fmax(s->stiff[a], fabs(f[1][a] - f[0][a]) / (2 * small));
    n = fmax(n, 30 * h * sqrt(s->stiff[a] / s->v[a][MASS]));
  }
  return ceil(n);
}

/* Whether all is well: parameters, ranges (told once), and numbers. */
static Status check(Device *d) {
  State *s = &d->s;
  Status status = OK;
  double x[AXES], all = 0;
  answer(s);
  where(s, x);
  for (int a = 0; a < AXES; a++) {
    double slack = 1e-9 * (GRID[a][COUNT[a] - 1] - GRID[a][0]);
    if (s->driven[a] && !(s->v[a][MASS] > 0))
      return tell(d, ERROR, NAME[a], " is driven by its force, which needs a mass above zero");
    all += x[a] + s->speed[a] + s->v[a][DUAL];
    if (s->told[a] || (x[a] >= GRID[a][0] - slack && x[a] <= GRID[a][COUNT[a] - 1] + slack)) continue;
    s->told[a] = 1;
    status = tell(d, WARNING, NAME[a], " is beyond the tables: the answers are extrapolated");
  }
  return isfinite(all) ? status : tell(d, ERROR, "", "a value is infinite or not a number");
}

/* --- functions of FMI 2.0 --------------------------------------------------------------------- */

static void reset(State *s) {
  memset(s, 0, sizeof *s);
  memcpy(s->v, VALUES, sizeof s->v);
  s->stale = 1;
}

FMI void *fmi2Instantiate(const char *name, int type, const char *guid, const char *resources,
                          const Callbacks *call, int visible, int logging) {
  Device *d = calloc(1, sizeof *d);
  if (!d) return NULL;
  if (call) d->call = *call;
  snprintf(d->name, sizeof d->name, "%s", name ? name : "");
  reset(&d->s);
  if (type == 1 && guid && !strcmp(guid, GUID)) return d;
  tell(d, ERROR, "", "this is for co-simulation, with the modelDescription.xml that it came with");
  free(d);
  return NULL;
}
FMI void fmi2FreeInstance(void *c) { free(c); }
FMI Status fmi2Reset(void *c) { return reset(&((Device *)c)->s), OK; }
FMI Status fmi2ExitInitializationMode(void *c) {
  Status status = check(c);
  ((Device *)c)->s.begun = 1;
  return status;
}

#define STATE ((Device *)c)->s
#define EACH(known, action) \
  for (size_t i = 0; i < n; i++) { \
    if (!(known)) return tell(c, ERROR, "", "there is no such variable, or not for this"); \
    action; \
  } \
  return OK;
FMI Status fmi2GetReal(void *c, References r, size_t n, double *out) {
  if (STATE.stale) answer(&STATE);
  EACH(r[i] <= AXES * SLOTS, out[i] = STATE.v[r[i] / SLOTS][r[i] % SLOTS])
}
FMI Status fmi2SetReal(void *c, References r, size_t n, const double *in) {
  STATE.stale = 1;
  EACH(r[i] < AXES * SLOTS && (r[i] % SLOTS < DUAL || r[i] % SLOTS > SPEED),
       STATE.v[r[i] / SLOTS][r[i] % SLOTS] = in[i])
}
FMI Status fmi2SetRealInputDerivatives(void *c, References r, size_t n, const int *order,
                                       const double *in) {
  EACH(r[i] < AXES * SLOTS && r[i] % SLOTS <= LOAD && order[i] == 1,
       STATE.rate[r[i] / SLOTS][r[i] % SLOTS] = in[i])
}
FMI Status fmi2GetBoolean(void *c, References r, size_t n, int *out) {
  EACH(r[i] < AXES, out[i] = STATE.driven[r[i]])
}
FMI Status fmi2SetBoolean(void *c, References r, size_t n, const int *in) {
  STATE.stale = 1;
  EACH(r[i] < AXES && MECHANICAL[r[i]], STATE.driven[r[i]] = in[i] != 0)
}

FMI Status fmi2DoStep(void *c, double t, double h, int final) {
  Device *d = c;
  Status status = h >= 0 ? check(d) : tell(d, ERROR, "", "a step goes forward");
  if (status >= DISCARD) return status;
  double n = steps(&d->s, h);
  if (!(n <= 1e6)) return tell(d, ERROR, "", "a mass is too small for its stiffness and this step");
  for (int i = 0; i < n; i++) advance(&d->s, h / n);
  Status end = check(d);
  memset(d->s.rate, 0, sizeof d->s.rate); /* given anew with each step */
  return end > status ? end : status;
}

/* states are plain memory, serialised or not */
FMI Status fmi2DeSerializeFMUstate(void *c, const char *in, size_t n, void **state) {
  if (!*state) *state = malloc(sizeof(State));
  if (!*state || n != sizeof(State)) return tell(c, ERROR, "", "this state is not to be had");
  return memcpy(*state, in, n), OK;
}
FMI Status fmi2GetFMUstate(void *c, void **state) {
  return fmi2DeSerializeFMUstate(c, (const char *)&STATE, sizeof(State), state);
}
FMI Status fmi2SetFMUstate(void *c, void *state) {
  return memcpy(&STATE, state, sizeof(State)), OK;
}
FMI Status fmi2FreeFMUstate(void *c, void **state) { return free(*state), *state = NULL, OK; }
FMI Status fmi2SerializedFMUstateSize(void *c, void *state, size_t *n) {
  return *n = sizeof(State), OK;
}
FMI Status fmi2SerializeFMUstate(void *c, void *state, char *out, size_t n) {
  return n < sizeof(State) ? ERROR : (memcpy(out, state, sizeof(State)), OK);
}

/* the rest has nothing to do here */
FMI const char *fmi2GetTypesPlatform(void) { return "default"; }
FMI const char *fmi2GetVersion(void) { return "2.0"; }
#define FUNCTION(name, status, ...) FMI Status name(void *c, ##__VA_ARGS__) { return status; }
FUNCTION(fmi2SetDebugLogging, OK, int on, size_t n, const char *const *which)
FUNCTION(fmi2SetupExperiment, OK, int bound, double tolerance, double t, int ends, double end)
FUNCTION(fmi2EnterInitializationMode, OK)
FUNCTION(fmi2Terminate, OK)
FUNCTION(fmi2GetInteger, n ? ERROR : OK, References r, size_t n, int *out)
FUNCTION(fmi2SetInteger, n ? ERROR : OK, References r, size_t n, const int *in)
FUNCTION(fmi2GetString, n ? ERROR : OK, References r, size_t n, const char **out)
FUNCTION(fmi2SetString, n ? ERROR : OK, References r, size_t n, const char *const *in)
FUNCTION(fmi2GetRealOutputDerivatives, n ? ERROR : OK, References r, size_t n, const int *k,
         double *out)
FUNCTION(fmi2GetDirectionalDerivative, ERROR, References of, size_t n, References by, size_t m,
         const double *in, double *out)
FUNCTION(fmi2CancelStep, ERROR)
FUNCTION(fmi2GetStatus, DISCARD, int kind, Status *out)
FUNCTION(fmi2GetRealStatus, DISCARD, int kind, double *out)
FUNCTION(fmi2GetIntegerStatus, DISCARD, int kind, int *out)
FUNCTION(fmi2GetBooleanStatus, DISCARD, int kind, int *out)
FUNCTION(fmi2GetStringStatus, DISCARD, int kind, const char **out)
