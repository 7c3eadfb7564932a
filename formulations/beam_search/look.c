/* How far branches break limits along one stage; limits.py says what is handed over. The formulas
   are those of areas.py and of whoever asks in numpy, in the same order, to the last bit. */
#include <math.h>
#include <stdint.h>

#define AREA 8 /* sign, east and north of the centre, radius, west, south, east and north ends */
#define EDGE 7 /* begin x, begin y, end y, east, north, squared, length */

struct limits {
  int64_t areas, auvs, points;
  const double* area;    /* of each: AREA */
  const int64_t* first;  /* of each, and past the last: its first edge; a disc has none */
  const double* edge;    /* of each: EDGE */
  const double* apart;   /* least and greatest separation, whether there is one, rounding */
  const double* margin;  /* of each AUV */
  const double* auv;     /* at each point: of each AUV, east and north */
  const double* drift;   /* at each point: how far the water has gone, east and north */
};

struct branches {
  int64_t turns;
  const double *x, *y, *cos, *sin; /* of each sequence */
  const double *ahead, *aside;     /* of each turn, at each point */
};

/* As numpy's: what is no number stays. */
static double max(double a, double b) { return a >= b || a != a ? a : b; }

static double outside(const struct limits* of, int64_t a, double x, double y) {
  const double* area = of->area + AREA * a;
  double off = INFINITY, corner = INFINITY;
  int inside = 0;
  if (of->first[a] == of->first[a + 1]) return hypot(x - area[1], y - area[2]) - area[3];
  for (int64_t i = of->first[a]; i < of->first[a + 1]; ++i) {
    const double* edge = of->edge + EDGE * i;
    const double dx = x - edge[0], dy = y - edge[1];
    const double along = dx * edge[3] + dy * edge[4];
    const double left = dy * edge[3] - dx * edge[4];
    const double squared = dx * dx + dy * dy;
    corner = squared < corner ? squared : corner;
    if (along > 0 && along < edge[5]) {
      const double abeam = fabs(left) / edge[5] * edge[6];
      off = abeam < off ? abeam : off;
    }
    inside ^= ((edge[1] > y) != (edge[2] > y)) & ((left > 0) == (edge[4] > 0));
  }
  corner = sqrt(corner);
  corner = off < corner ? off : corner;
  return inside ? -corner : corner;
}

static double too_near_or_far(const struct limits* of, int64_t t, double x, double y) {
  double worst = -INFINITY;
  for (int64_t m = 0; m < of->auvs; ++m) {
    const double* auv = of->auv + 2 * (of->auvs * t + m);
    const double east = x - auv[0], north = y - auv[1];
    const double distance = sqrt(east * east + north * north);
    double broken = distance - of->apart[1];
    if (of->apart[0] > 0) broken = max(of->apart[0] - distance, broken);
    worst = max(worst, broken + of->margin[m]);
  }
  return worst;
}

static double worst_along(const struct limits* of, const double* x, const double* y) {
  const int64_t middle = of->points / 2;
  double worst = 0.0, reach = 0.0;
  for (int64_t t = 0; t < of->points; ++t) {
    const double east = x[t] - x[middle], north = y[t] - y[middle];
    reach = max(reach, east * east + north * north);
    if (x[t] + y[t] != x[t] + y[t]) return NAN;
    if (of->apart[2]) worst = max(worst, too_near_or_far(of, t, x[t], y[t]));
  }
  reach = sqrt(reach) + of->apart[3];
  for (int64_t a = 0; a < of->areas; ++a) {
    const double* area = of->area + AREA * a;
    const double sign = area[0];
    if (x[middle] < area[4] - reach || y[middle] < area[5] - reach) continue;
    if (x[middle] > area[6] + reach || y[middle] > area[7] + reach) continue;
    if (!(sign * outside(of, a, x[middle], y[middle]) > -reach)) continue;
    for (int64_t t = 0; t < of->points; ++t) worst = max(worst, sign * outside(of, a, x[t], y[t]));
  }
  return worst;
}

void look(int64_t count, const int64_t* these, const struct branches* from,
          const struct limits* of, double* broken) {
  double x[of->points], y[of->points];
  for (int64_t i = 0; i < count; ++i) {
    const int64_t parent = these[i] / from->turns, turn = these[i] % from->turns;
    const double cos = from->cos[parent], sin = from->sin[parent];
    for (int64_t t = 0; t < of->points; ++t) {
      const double ahead = from->ahead[of->points * turn + t];
      const double aside = from->aside[of->points * turn + t];
      x[t] = from->x[parent] + cos * ahead - sin * aside + of->drift[2 * t];
      y[t] = from->y[parent] + sin * ahead + cos * aside + of->drift[2 * t + 1];
    }
    broken[i] = worst_along(of, x, y);
  }
}
