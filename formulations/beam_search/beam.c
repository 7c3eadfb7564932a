/* Beam search over turns, stage by stage. compiled.py writes before this text how many AUVS and
   TURNS there are, the sizes HALF, AUV and STAGE, the places SHARE and WEIGHT in what a stage is
   told, and the formulas `composed` and `of_one` for LANES sequences side by side. */

/* What a stage is told: AUV of each, STAGE, the moves of the turns. */
#define STAGE_AT (AUV * AUVS)
#define MOVES_AT (STAGE_AT + STAGE)
#define TOLD (MOVES_AT + 3 * TURNS)

#define FEW 16       /* costs that are put in order one by one */
#define BUCKETS 256  /* among which more are divided */

/* LANES sequences. */
struct block {
  lanes pose[3];
  lanes covariance[AUVS][HALF]; /* before the last stage's ranges */
  lanes cost;
};

/* What they branch into: poses after each turn; covariances do not depend on it. */
struct branches {
  lanes pose[TURNS][3];
  lanes covariance[AUVS][HALF];
};

/* Memory of a search; compiled.py says how much there is of each. */
struct memory {
  struct block* beam;
  double* cost;  /* of each branch, of one sequence after the other */
  double* rank;  /* the same, and what is to come */
  int64_t* kept; /* branches kept after each stage */
  struct branches* branches;
  int64_t *key, *among;
};

static int64_t blocks(int64_t sequences) { return (sequences + LANES - 1) / LANES; }

/* Costs and ranks of all branches of the sequences in the beam, where they lead, and what is known
   there. */
__attribute__((noinline)) void branch(int64_t count, const double* told, struct memory* of) {
  const double *stage = told + STAGE_AT, *moves = told + MOVES_AT;
  const lanes share = all(stage[SHARE]);
  for (int64_t b = 0; b < blocks(count); ++b) {
    const struct block* from = of->beam + b;
    struct branches* to = of->branches + b;
    lanes known[TURNS], to_go[TURNS], total[TURNS] = {{0}}, to_come[TURNS] = {{0}};
    composed(from->pose, moves, (lanes*)to->pose);
    for (int m = 0; m < AUVS; ++m) {
      const double* auv = told + AUV * m;
      of_one(from->covariance[m], auv, from->pose, (lanes*)to->pose, stage, known, to_go,
             to->covariance[m]);
      const lanes weight = all(auv[WEIGHT]);
      for (int k = 0; k < TURNS; ++k) total[k] += known[k] * weight;
      for (int k = 0; k < TURNS; ++k) to_come[k] += to_go[k];
    }
    for (int k = 0; k < TURNS; ++k) {
      const lanes cost = from->cost + share * total[k];
      const lanes rank = cost + to_come[k];
      for (int i = 0; i < LANES; ++i) {
        of->cost[TURNS * (LANES * b + i) + k] = cost[i];
        of->rank[TURNS * (LANES * b + i) + k] = rank[i];
      }
    }
  }
}

/* Whole numbers in the order of costs without their last bits: rounding decides between no two.
   What is no number counts as dearest. */
static int64_t key_of(double cost) {
  int64_t bits;
  cost += 0.0; /* of two zeros none is cheaper */
  memcpy(&bits, &cost, sizeof bits);
  if (cost == cost) bits = (bits + ((int64_t)1 << (DROPPED - 1))) & -((int64_t)1 << DROPPED);
  const int64_t key = bits < 0 ? bits ^ INT64_MAX : bits;
  return cost == cost ? key : INT64_MAX;
}

static void sort(int64_t count, int64_t* key) {
  for (int64_t i = 1; i < count; ++i) {
    const int64_t this = key[i];
    int64_t j = i;
    for (; j > 0 && key[j - 1] > this; --j) key[j] = key[j - 1];
    key[j] = this;
  }
}

/* The k-th least, counted from 0: all are divided into buckets, and again those of its bucket. */
static int64_t selected(int64_t count, const int64_t* key, int64_t k, int64_t* among) {
  const int64_t* from = key;
  while (count > FEW) {
    int64_t held[BUCKETS] = {0}, bucket = 0, n = 0;
    int64_t least = from[0], most = from[0];
    for (int64_t i = 1; i < count; ++i) {
      least = from[i] < least ? from[i] : least;
      most = from[i] > most ? from[i] : most;
    }
    if (least == most) return least;
    const uint64_t range = (uint64_t)most - (uint64_t)least;
    const int shift = range < BUCKETS ? 0 : 56 - __builtin_clzll(range);
#define BUCKET(key) (int64_t)(((uint64_t)(key) - (uint64_t)least) >> shift)
    for (int64_t i = 0; i < count; ++i) ++held[BUCKET(from[i])];
    while (held[bucket] <= k) k -= held[bucket++];
    for (int64_t i = 0; i < count; ++i) {
      const int64_t this = from[i];
      among[n] = this;
      n += BUCKET(this) == bucket;
    }
    from = among;
    count = n;
  }
  if (from == key) memcpy(among, key, sizeof *key * count);
  sort(count, among);
  return among[k];
}

/* The cheapest, in their own order, of equals those that come first; returns how many.
   In `key` and `among` there is room for all. */
int64_t cheapest(int64_t count, const double* cost, int64_t wanted, int64_t* kept, int64_t* key,
                 int64_t* among) {
  int64_t n = 0, equals = wanted;
  if (count <= wanted) {
    for (; n < count; ++n) kept[n] = n;
    return n;
  }
  for (int64_t i = 0; i < count; ++i) key[i] = key_of(cost[i]);
  const int64_t last = selected(count, key, wanted - 1, among);
  for (int64_t i = 0; i < count; ++i) equals -= key[i] < last;
  for (int64_t i = 0; n < wanted; ++i) {
    const int64_t equal = (key[i] == last) & (equals > 0);
    kept[n] = i;
    n += equal | (key[i] < last);
    equals -= equal;
  }
  return n;
}

/* Make the beam of the branches that are kept. */
__attribute__((noinline)) void follow(int64_t count, const int64_t* kept, struct memory* of) {
  for (int64_t i = 0; i < count; ++i) {
    const int64_t parent = kept[i] / TURNS, turn = kept[i] % TURNS;
    const struct branches* from = of->branches + parent / LANES;
    struct block* to = of->beam + i / LANES;
    const double *pose = (const double*)from->pose[turn] + parent % LANES;
    const double *covariance = (const double*)from->covariance + parent % LANES;
    double *next_pose = (double*)to->pose + i % LANES;
    double *next_covariance = (double*)to->covariance + i % LANES;
    for (int j = 0; j < 3; ++j) next_pose[LANES * j] = pose[LANES * j];
    for (int j = 0; j < AUVS * HALF; ++j) next_covariance[LANES * j] = covariance[LANES * j];
    ((double*)&to->cost)[i % LANES] = of->cost[kept[i]];
  }
}

/* Make the beam of the one sequence without turns. */
void begin(const double* pose, const double* covariance, struct memory* of) {
  lanes* P = (lanes*)of->beam->covariance;
  for (int j = 0; j < 3; ++j) of->beam->pose[j] = all(pose[j]);
  for (int j = 0; j < AUVS * HALF; ++j) P[j] = all(covariance[j]);
  of->beam->cost = all(0.0);
}

/* The whole search without limits. */
void search(int64_t stages, int64_t width, const double* told, struct memory* of) {
  for (int64_t s = 0, count = 1; s < stages; ++s) {
    int64_t* kept = of->kept + width * s;
    branch(count, told + TOLD * s, of);
    count = cheapest(TURNS * count, of->rank, s < stages - 1 ? width : 1, kept, of->key, of->among);
    follow(count, kept, of);
  }
}

/* The first sequence of the last beam: its turns by number; its cost and, in `found` after it, the
   poses at the beginning and the ends of the stages. */
void first(int64_t stages, int64_t width, const double* told, const struct memory* of,
           const double* pose, int64_t* turns, double* found) {
  for (int64_t s = stages - 1, k = 0; s >= 0; --s) {
    turns[s] = of->kept[width * s + k] % TURNS;
    k = of->kept[width * s + k] / TURNS;
  }
  found[0] = of->beam->cost[0];
  for (int j = 0; j < 3; ++j) found[1 + j] = pose[j];
  for (int64_t s = 0; s < stages; ++s) {
    const double* before = found + 1 + 3 * s;
    const lanes at[3] = {all(before[0]), all(before[1]), all(before[2])};
    lanes next[TURNS][3];
    composed(at, told + TOLD * s + MOVES_AT, (lanes*)next);
    for (int j = 0; j < 3; ++j) found[4 + 3 * s + j] = next[turns[s]][j][0];
  }
}
