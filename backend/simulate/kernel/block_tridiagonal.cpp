// The compiled twin of backend/simulate/linear.py: a block tridiagonal matrix over the levels of the body graph.
//
// A level's block is n x n, n = 6 x width.

#include <cmath>
#include <cstring>

#include "batches.h"

namespace {

constexpr int BODY = 6, ROWS = 6, PAIR = 12;
constexpr double UNPIVOTED = 1e3;  // times a pivot: entries behind it in its row may be as large before others are sought

// The size of a block: known when compiled for narrow mechanisms, so that loops unroll, or only when run.
template <int N>
struct Fixed {
  constexpr operator int() const { return N; }
};
struct Loose {
  int size;
  operator int() const { return size; }
};

// Doubles that the processor treats as one where it can.
typedef double Two __attribute__((vector_size(16)));
typedef double Four __attribute__((vector_size(32)));
typedef double Eight __attribute__((vector_size(64)));
typedef int64_t EightNumbers __attribute__((vector_size(64)));

// Entry (i, k) of a matrix is at[i * by_row + k * by_column].
struct Strided {
  const double* at;
  int by_row, by_column;
};

// Six rows and a few columns of c += sign a b; their sums stay in registers.
template <class Lanes>
inline void multiply_tile(int depth, double sign, Strided a, const double* b, int b_row, double* c, int c_row) {
  Lanes sum[BODY] = {};
  for (int k = 0; k < depth; ++k) {
    Lanes row;
    std::memcpy(&row, b + k * b_row, sizeof row);
    for (int i = 0; i < BODY; ++i) sum[i] += a.at[i * a.by_row + k * a.by_column] * row;
  }
  for (int i = 0; i < BODY; ++i) {
    Lanes row;
    std::memcpy(&row, c + i * c_row, sizeof row);
    row += sign * sum[i];
    std::memcpy(c + i * c_row, &row, sizeof row);
  }
}

// c += sign a b; rows of c in sixes, columns even
template <class Rows, class Columns>
inline void multiply(Rows rows, int depth, double sign, Strided a, const double* b, double* c, Columns columns) {
  for (int i = 0; i < rows; i += BODY) {
    const Strided from = {a.at + i * a.by_row, a.by_row, a.by_column};
    double* to = c + i * columns;
    int j = 0;
    for (; j + 8 <= columns; j += 8) multiply_tile<Eight>(depth, sign, from, b + j, columns, to + j, columns);
    for (; j + 4 <= columns; j += 4) multiply_tile<Four>(depth, sign, from, b + j, columns, to + j, columns);
    for (; j < columns; j += 2) multiply_tile<Two>(depth, sign, from, b + j, columns, to + j, columns);
  }
}

template <class Lanes>
inline void add_lanes(double times, const double* x, double* y) {
  Lanes from, to;
  std::memcpy(&from, x, sizeof from);
  std::memcpy(&to, y, sizeof to);
  to += times * from;
  std::memcpy(y, &to, sizeof to);
}

// y += times x, an even number of entries
template <class Size>
inline void add(Size n, double times, const double* x, double* y) {
  int j = 0;
  for (; j + 8 <= n; j += 8) add_lanes<Eight>(times, x + j, y + j);
  for (; j + 4 <= n; j += 4) add_lanes<Four>(times, x + j, y + j);
  for (; j < n; j += 2) add_lanes<Two>(times, x + j, y + j);
}

// y <- keep y + times x
template <class Lanes>
inline void blend_lanes(const double* keep, double times, const double* x, double* y) {
  Lanes kept, from, to;
  std::memcpy(&kept, keep, sizeof kept);
  std::memcpy(&from, x, sizeof from);
  std::memcpy(&to, y, sizeof to);
  to = kept * to + times * from;
  std::memcpy(y, &to, sizeof to);
}

template <class Size>
inline void blend(Size n, const double* keep, double times, const double* x, double* y) {
  int j = 0;
  for (; j + 4 <= n; j += 4) blend_lanes<Four>(keep + j, times, x + j, y + j);
  for (; j < n; j += 2) blend_lanes<Two>(keep + j, times, x + j, y + j);
}

// Room for one block and its pivots.
struct Scratch {
  std::vector<double> block, beside, pivot_row, ones;
  std::vector<int> pivot;  // column of each row's pivot
  std::vector<char> taken;
  void fit(int n) {
    if (static_cast<int>(pivot.size()) == n) return;
    block.resize(n * n), beside.resize(n * n), pivot_row.resize(n), pivot.resize(n), taken.resize(n);
    ones.assign(2 * n, 1.0);
    ones[n] = 0.0;
  }
};

// a <- a^-1 and above, if there is any, <- a^-1 above, by Gauss and Jordan, each row's pivot its largest entry in a column
// not taken yet.  A singular block becomes inf and NaN.  Rows are written whole: a single entry written into a row stalls
// the next reading of the row.
//
// Both come of the same row operations: the product of inverse and `above` would be off by rounding times the condition
// of a, which outweighs a body's mass where a stiff joint links it to one that nothing stiff holds.
template <class Size>
void eliminate(Size n, double* __restrict a, double* __restrict above, Scratch& scratch) {
  double *b = scratch.block.data(), *beside = scratch.beside.data(), *pivot_row = scratch.pivot_row.data();
  int* __restrict pivot = scratch.pivot.data();
  char* __restrict taken = scratch.taken.data();
  std::copy_n(a, n * n, b);
  if (above) std::copy_n(above, n * n, beside);
  std::fill_n(taken, n, 0);
  for (int k = 0; k < n; ++k) {
    const double* row = b + k * n;
    int column = 0;
    while (taken[column]) ++column;
    double largest = std::fabs(row[column]);
    for (int j = column + 1; j < n; ++j) {
      const double size = std::fabs(row[j]);
      if (size > largest && !taken[j]) largest = size, column = j;
    }
    pivot[k] = column;
    taken[column] = 1;
    const double by = 1.0 / row[column];
    const double* but = scratch.ones.data() + (n - column);  // 0 in the pivot's column, 1 elsewhere
    for (int j = 0; j < n; ++j) pivot_row[j] = by * (but[j] * row[j] + (1.0 - but[j]));
    if (above)
      for (int j = 0; j < n; ++j) beside[k * n + j] *= by;
    for (int step = 1; step < n; ++step) {  // the next row first: its pivot is sought while the others follow
      const int i = k + step < n ? k + step : k + step - n;
      const double times = -b[i * n + column];
      if (above) add(n, times, beside + k * n, beside + i * n);
      blend(n, but, times, pivot_row, b + i * n);
    }
    std::copy_n(pivot_row, n, b + k * n);
  }
  for (int k = 0; k < n; ++k) {
    for (int m = 0; m < n; ++m) a[pivot[k] * n + m] = b[k * n + pivot[m]];
    if (above) std::copy_n(beside + k * n, n, above + pivot[k] * n);
  }
}

// Some columns of the rows beside a block, as its elimination changes them: row k is taken share[k][i] times off every
// other row i, and then times share[k][k].
template <class Lanes, int N>
inline void follow(const double (&share)[N][N], double* rows) {
  Lanes b[N];
  for (int i = 0; i < N; ++i) std::memcpy(&b[i], rows + i * N, sizeof b[i]);
#pragma GCC unroll 24  // so that all of b stays in registers
  for (int k = 0; k < N; ++k) {
    const Lanes row = b[k];
#pragma GCC unroll 24
    for (int i = 0; i < N; ++i) b[i] -= share[k][i] * row;
    b[k] = share[k][k] * row;
  }
  for (int i = 0; i < N; ++i) std::memcpy(rows + i * N, &b[i], sizeof b[i]);
}

// The same with the pivots in their order, as matrices of inertia and stiffness allow.  Where one of them is too small
// all stays as it was, and the answer is false.
template <int N>
bool eliminate_in_order(Fixed<N>, double* __restrict a, double* __restrict above) {
  constexpr int LANES = 8, PARTS = (N + LANES - 1) / LANES;
  constexpr EightNumbers COUNT = {0, 1, 2, 3, 4, 5, 6, 7};
  constexpr Eight ZERO = {};
  Eight b[N][PARTS] = {}, largest = ZERO;
  double share[N][N];
  for (int i = 0; i < N; ++i) std::memcpy(b[i], a + i * N, N * sizeof(double));
#pragma GCC unroll 12
  for (int k = 0; k < N; ++k) {
    const int part = k / LANES, lane = k % LANES;
    const double by = share[k][k] = 1.0 / b[k][part][lane];
    Eight row[PARTS];
    for (int p = 0; p < PARTS; ++p) {
      const EightNumbers beyond = COUNT - (k - p * LANES);
      row[p] = beyond == 0 ? ZERO + by : by * b[k][p];
      const Eight behind = beyond > 0 ? row[p] : ZERO, size = behind < 0.0 ? -behind : behind;
      largest = size > largest ? size : largest;
    }
    for (int step = 1; step < N; ++step) {
      const int i = (k + step) % N;  // as above
      const double times = share[k][i] = b[i][part][lane];
      for (int p = 0; p < PARTS; ++p) b[i][p] = (COUNT == k - p * LANES ? ZERO : b[i][p]) - times * row[p];
    }
    std::copy_n(row, PARTS, b[k]);
  }
  for (int j = 0; j < LANES; ++j)
    if (!(largest[j] < UNPIVOTED)) return false;
  for (int i = 0; i < N; ++i) std::memcpy(a + i * N, b[i], N * sizeof(double));
  if (!above) return true;
  for (int k = 0; k < N; ++k) {
    const double by = share[k][k];
    for (int i = 0; i < N; ++i) share[k][i] *= by;
    share[k][k] = by;
  }
  int j = 0;
  for (; j + 8 <= N; j += 8) follow<Eight>(share, above + j);
  for (; j + 4 <= N; j += 4) follow<Four>(share, above + j);
  for (; j < N; j += 2) follow<Two>(share, above + j);
  return true;
}

inline bool eliminate_in_order(Loose, double*, double*) { return false; }

// What a . b is the total of; n is a multiple of the lanes.
template <class Lanes>
inline Lanes products(int n, const double* a, const double* b) {
  Lanes sum = {};
  for (int k = 0; k < n; k += sizeof(Lanes) / sizeof(double)) {
    Lanes of_a, of_b;
    std::memcpy(&of_a, a + k, sizeof of_a);
    std::memcpy(&of_b, b + k, sizeof of_b);
    sum += of_a * of_b;
  }
  return sum;
}

inline double total(const Two& x) { return x[0] + x[1]; }
inline double total(const Four& x) { return (x[0] + x[1]) + (x[2] + x[3]); }

// y += sign a x
template <class Size>
void apply(Size n, double sign, const double* __restrict a, const double* __restrict x, double* __restrict y) {
  for (int i = 0; i < n; ++i) {
    const double* row = a + i * n;
    y[i] += sign * (n % 4 == 0 ? total(products<Four>(n, row, x)) : total(products<Two>(n, row, x)));
  }
}

// y += sign a^T x
template <class Size>
void apply_transposed(Size n, double sign, const double* __restrict a, const double* __restrict x,
                      double* __restrict y) {
  for (int k = 0; k < n; ++k) add(n, sign * x[k], a + k * n, y);
}

// One matrix: what a factorisation reads and writes.
struct Blocks {
  const double *bodies, *left, *stiffness, *right, *others;
  double *pivot_inverse, *lower, *coupling;
};

struct Shape {
  int64_t levels, width, joints, others;
  bool coupled;  // whether a joint's rows have a full stiffness, or each its own
  const int32_t* links;  // slots of both ends, joints first
};

// Calls `add` with the first row and column of each 6 x 6 block of one link, and with where the block stands.
template <class Size, class Add>
void place(Size n, const Shape& shape, int64_t link, const Blocks& to, const Add& add) {
  const int64_t slots = shape.levels * shape.width;
  for (int row_side = 0; row_side < 2; ++row_side) {
    const int64_t row = shape.links[2 * link + row_side];
    if (row >= slots) continue;
    for (int column_side = 0; column_side < 2; ++column_side) {
      const int64_t column = shape.links[2 * link + column_side];
      if (column >= slots) continue;
      const int64_t level_row = row / shape.width, level_column = column / shape.width;
      double* level = level_row == level_column  ? to.pivot_inverse
                      : level_row < level_column ? to.coupling
                                                 : to.lower;
      level += std::min(level_row, level_column) * n * n;
      add(row_side * BODY, column_side * BODY, level + ((row % shape.width) * n + column % shape.width) * BODY);
    }
  }
}

template <class Size>
void assemble(Size n, const Shape& shape, const Blocks& at) {
  const int64_t size = shape.levels * n * n;
  for (double* out : {at.pivot_inverse, at.lower, at.coupling}) std::fill_n(out, size, 0.0);
  for (int64_t slot = 0; slot < shape.levels * shape.width; ++slot) {
    double* corner = at.pivot_inverse + (slot / shape.width) * n * n + (slot % shape.width) * BODY * (n + 1);
    for (int i = 0; i < BODY; ++i) std::copy_n(at.bodies + (slot * BODY + i) * BODY, BODY, corner + i * n);
  }
  for (int64_t joint = 0; joint < shape.joints; ++joint) {
    const double *left = at.left + joint * ROWS * PAIR, *right = at.right + joint * ROWS * PAIR;
    double pull[ROWS * PAIR] = {};  // stiffness x right
    if (shape.coupled)
      multiply(Fixed<ROWS>(), ROWS, 1.0, {at.stiffness + joint * ROWS * ROWS, ROWS, 1}, right, pull, Fixed<PAIR>());
    else
      for (int i = 0; i < ROWS; ++i) add(Fixed<PAIR>(), at.stiffness[joint * ROWS + i], right + i * PAIR, pull + i * PAIR);
    place(n, shape, joint, at, [&](int row, int column, double* to) {
      multiply_tile<Four>(ROWS, 1.0, {left + row, 1, PAIR}, pull + column, PAIR, to, n);
      multiply_tile<Two>(ROWS, 1.0, {left + row, 1, PAIR}, pull + column + 4, PAIR, to + 4, n);
    });
  }
  for (int64_t other = 0; other < shape.others; ++other)
    place(n, shape, shape.joints + other, at, [&](int row, int column, double* to) {
      const double* block = at.others + other * PAIR * PAIR + row * PAIR + column;
      for (int i = 0; i < BODY; ++i) add(Fixed<BODY>(), 1.0, block + i * PAIR, to + i * n);
    });
}

template <class Size>
void factor_one(Size n, const Shape& shape, const Blocks& at) {
  assemble(n, shape, at);
  const int64_t size = static_cast<int64_t>(n) * n;
  thread_local Scratch scratch;
  scratch.fit(n);
  for (int64_t level = 0; level < shape.levels; ++level) {
    const bool last = level + 1 == shape.levels;
    double *inverse = at.pivot_inverse + level * size, *coupling = last ? nullptr : at.coupling + level * size;
    if (!eliminate_in_order(n, inverse, coupling)) eliminate(n, inverse, coupling, scratch);
    if (!last) multiply(n, n, -1.0, {at.lower + level * size, n, 1}, coupling, inverse + size, n);
  }
}

// x = M^-1 b with M = (pivots + lower) (1 + coupling), level by level
template <class Size>
void solve_one(Size n, int64_t levels, const double* inverse, const double* lower, const double* coupling,
               const double* b, double* x) {
  const int64_t size = static_cast<int64_t>(n) * n;
  thread_local std::vector<double> left_over;
  left_over.assign(b, b + levels * n);
  std::fill_n(x, levels * n, 0.0);
  for (int64_t level = 0; level < levels; ++level) {
    apply(n, 1.0, inverse + level * size, &left_over[level * n], x + level * n);
    if (level + 1 < levels) apply(n, -1.0, lower + level * size, x + level * n, &left_over[(level + 1) * n]);
  }
  for (int64_t level = levels - 2; level >= 0; --level)
    apply(n, -1.0, coupling + level * size, x + (level + 1) * n, x + level * n);
}

// x = M^-T b
template <class Size>
void solve_transposed_one(Size n, int64_t levels, const double* inverse, const double* lower, const double* coupling,
                          const double* b, double* x) {
  const int64_t size = static_cast<int64_t>(n) * n;
  thread_local std::vector<double> left_over;
  left_over.assign(b, b + levels * n);
  std::fill_n(x, levels * n, 0.0);
  for (int64_t level = 0; level + 1 < levels; ++level)
    apply_transposed(n, -1.0, coupling + level * size, &left_over[level * n], &left_over[(level + 1) * n]);
  for (int64_t level = levels - 1; level >= 0; --level) {
    apply_transposed(n, 1.0, inverse + level * size, &left_over[level * n], x + level * n);
    if (level > 0) apply_transposed(n, -1.0, lower + (level - 1) * size, x + level * n, &left_over[(level - 1) * n]);
  }
}

// Calls `with` with the block size, as a constant for up to four bodies a level.
template <class Call>
void sized(int64_t width, const Call& with) {
  switch (width) {
    case 1: return with(Fixed<6>());
    case 2: return with(Fixed<12>());
    case 3: return with(Fixed<18>());
    case 4: return with(Fixed<24>());
    default: return with(Loose{static_cast<int>(BODY * width)});
  }
}

ffi::Error factor(ffi::ThreadPool pool, Real bodies, Real left, Real stiffness, Real right, Real others,
                  RealResult pivot_inverse, RealResult lower, RealResult coupling, Slots links, int64_t width) {
  const auto batch = batch_of(pivot_inverse->dimensions(), 3);
  const size_t lead = batch.size();
  const size_t own = stiffness.dimensions().size() - lead;
  const Shape shape = {pivot_inverse->dimensions()[lead], width,         left.dimensions()[lead],
                       others.dimensions()[lead],         own == 3, links.begin()};
  if (static_cast<int64_t>(links.size()) != 2 * (shape.joints + shape.others))
    return ffi::Error::InvalidArgument("block_tridiagonal: a joint or another link lacks its two slots");
  const Samples of_bodies(bodies.dimensions(), 3, batch), of_left(left.dimensions(), 3, batch),
      of_stiffness(stiffness.dimensions(), own, batch), of_right(right.dimensions(), 3, batch), of_others(others.dimensions(), 3, batch);
  const int64_t n = BODY * width, size = shape.levels * n * n;
  sized(width, [&](auto known) {
    spread(pool, count(batch), 6.0 * size * n, [&](int64_t sample) {
      factor_one(known, shape,
                 {bodies.typed_data() + of_bodies(sample), left.typed_data() + of_left(sample),
                  stiffness.typed_data() + of_stiffness(sample), right.typed_data() + of_right(sample), others.typed_data() + of_others(sample),
                  pivot_inverse->typed_data() + sample * size, lower->typed_data() + sample * size,
                  coupling->typed_data() + sample * size});
    });
  });
  return ffi::Error::Success();
}

ffi::Error solve(ffi::ThreadPool pool, Real pivot_inverse, Real lower, Real coupling, Real rhs, RealResult x,
                 bool transposed) {
  const auto batch = batch_of(x->dimensions(), 2);
  const auto blocks = pivot_inverse.dimensions();
  const int64_t levels = blocks[batch.size()], n = blocks[batch.size() + 1];
  const Samples of_pivots(blocks, 3, batch), of_lower(lower.dimensions(), 3, batch),
      of_coupling(coupling.dimensions(), 3, batch), of_rhs(rhs.dimensions(), 2, batch);
  sized(n / BODY, [&](auto known) {
    spread(pool, count(batch), 3.0 * levels * n * n, [&](int64_t sample) {
      const double *inverse = pivot_inverse.typed_data() + of_pivots(sample),
                   *below = lower.typed_data() + of_lower(sample),
                   *above = coupling.typed_data() + of_coupling(sample), *b = rhs.typed_data() + of_rhs(sample);
      double* to = x->typed_data() + sample * levels * n;
      if (transposed)
        solve_transposed_one(known, levels, inverse, below, above, b, to);
      else
        solve_one(known, levels, inverse, below, above, b, to);
    });
  });
  return ffi::Error::Success();
}

}  // namespace

XLA_FFI_DEFINE_HANDLER_SYMBOL(BlockTridiagonalFactor, factor,
                              ffi::Ffi::Bind()
                                  .Ctx<ffi::ThreadPool>()
                                  .Arg<Real>()
                                  .Arg<Real>()
                                  .Arg<Real>()
                                  .Arg<Real>()
                                  .Arg<Real>()
                                  .Ret<Real>()
                                  .Ret<Real>()
                                  .Ret<Real>()
                                  .Attr<Slots>("links")
                                  .Attr<int64_t>("width"));

XLA_FFI_DEFINE_HANDLER_SYMBOL(BlockTridiagonalSolve, solve,
                              ffi::Ffi::Bind()
                                  .Ctx<ffi::ThreadPool>()
                                  .Arg<Real>()
                                  .Arg<Real>()
                                  .Arg<Real>()
                                  .Arg<Real>()
                                  .Ret<Real>()
                                  .Attr<bool>("transposed"));
