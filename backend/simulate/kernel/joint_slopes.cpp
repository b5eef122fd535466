// The compiled twin of the derivatives of `_rows`, `_wrenches` and `coordinates` in backend/simulate/kinematics.py: what
// joints measure, along changes of where their bodies are and how they were drawn, and the transpose of that.

#include <optional>

#include "batches.h"
#include "vectors.h"

namespace {

constexpr int OPERANDS = 7;
enum Operand { POSITION, ROTATION, AXES_A, AXES_B, POINT_A, POINT_B, IMPULSES };
constexpr size_t DIMENSIONS[OPERANDS] = {2, 3, 3, 3, 2, 2, 2};  // of each, without the batch
constexpr int64_t SIZE[OPERANDS] = {3, 9, 9, 9, 3, 3, 6};       // of each body's or joint's part
constexpr int32_t TURNS = 1, SLIDES = 2;                        // bits of what a joint does freely

// Everything of some joints, or the change of all that, or what a change of all that is worth.
struct Joints {
  Vector x_A, x_B, r_A, r_B, force, torque;
  Matrix R_A, R_B, F_A, F_B;
};

// What they do freely: 1 or 0.
struct Free {
  Number turn = {}, slide = {};
};

// What all measures are made of, in W: axes of frame A; x and z of frame B; from body A to the joint, from body B, and
// from body A to the joint on B.
struct World {
  Vector x_A, y_A, z_A, x_B, z_B, arm_a, arm_b, lever;
};

ALWAYS World world(const Joints& at) {
  World w;
  w.x_A = times(at.R_A, at.F_A.column(0));
  w.y_A = times(at.R_A, at.F_A.column(1));
  w.z_A = times(at.R_A, at.F_A.column(2));
  w.x_B = times(at.R_B, at.F_B.column(0));
  w.z_B = times(at.R_B, at.F_B.column(2));
  w.arm_a = times(at.R_A, at.r_A);
  w.arm_b = times(at.R_B, at.r_B);
  w.lever = at.x_B + w.arm_b - at.x_A;
  return w;
}

ALWAYS World change(const Joints& at, const Joints& by) {
  World w;
  w.x_A = times(by.R_A, at.F_A.column(0)) + times(at.R_A, by.F_A.column(0));
  w.y_A = times(by.R_A, at.F_A.column(1)) + times(at.R_A, by.F_A.column(1));
  w.z_A = times(by.R_A, at.F_A.column(2)) + times(at.R_A, by.F_A.column(2));
  w.x_B = times(by.R_B, at.F_B.column(0)) + times(at.R_B, by.F_B.column(0));
  w.z_B = times(by.R_B, at.F_B.column(2)) + times(at.R_B, by.F_B.column(2));
  w.arm_a = times(by.R_A, at.r_A) + times(at.R_A, by.r_A);
  w.arm_b = times(by.R_B, at.r_B) + times(at.R_B, by.r_B);
  w.lever = by.x_B + w.arm_b - by.x_A;
  return w;
}

// The transpose of `change`, added.
ALWAYS void send_back(const Joints& at, World w, Joints& to) {
  const auto column = [](const Vector& of, const Matrix& R, const Matrix& F, int k, Matrix& to_R, Matrix& to_F) {
    add_outer(of, F.column(k), to_R);
    add_to_column(k, transposed_times(R, of), to_F);
  };
  const auto arm = [](const Vector& of, const Matrix& R, const Vector& r, Matrix& to_R, Vector& to_r) {
    add_outer(of, r, to_R);
    add(transposed_times(R, of), to_r);
  };
  add(w.lever, to.x_B);
  add(-w.lever, to.x_A);
  add(w.lever, w.arm_b);
  column(w.x_A, at.R_A, at.F_A, 0, to.R_A, to.F_A);
  column(w.y_A, at.R_A, at.F_A, 1, to.R_A, to.F_A);
  column(w.z_A, at.R_A, at.F_A, 2, to.R_A, to.F_A);
  column(w.x_B, at.R_B, at.F_B, 0, to.R_B, to.F_B);
  column(w.z_B, at.R_B, at.F_B, 2, to.R_B, to.F_B);
  arm(w.arm_a, at.R_A, at.r_A, to.R_A, to.r_A);
  arm(w.arm_b, at.R_B, at.r_B, to.R_B, to.r_B);
}

// Values of the six rows.
struct Value {
  static constexpr int COUNT = 6;

  ALWAYS static void along(const Joints& at, const World& w, const Joints& by, const World& d, const Free&, Number* out) {
    const Vector past = transposed_times(at.R_A, w.lever) - at.r_A;
    const Vector moved = transposed_times(by.R_A, w.lever) + transposed_times(at.R_A, d.lever) - by.r_A;
    const Vector offset = transposed_times(by.F_A, past) + transposed_times(at.F_A, moved);
    for (int i = 0; i < 3; ++i) out[i] = offset[i];
    out[3] = dot(d.x_A, w.z_B) + dot(w.x_A, d.z_B);
    out[4] = dot(d.y_A, w.z_B) + dot(w.y_A, d.z_B);
    out[5] = dot(d.y_A, w.x_B) + dot(w.y_A, d.x_B);
  }

  ALWAYS static void back(const Joints& at, const World& w, const Number* of, const Free&, Joints& to, World& back) {
    const Vector offset = {of[0], of[1], of[2]};
    const Vector past = transposed_times(at.R_A, w.lever) - at.r_A, moved = times(at.F_A, offset);
    add_outer(past, offset, to.F_A);
    add(-moved, to.r_A);
    add_outer(w.lever, moved, to.R_A);
    back.lever = times(at.R_A, moved);
    back.x_A = of[3] * w.z_B;
    back.y_A = of[4] * w.z_B + of[5] * w.x_B;
    back.z_B = of[3] * w.x_A + of[4] * w.y_A;
    back.x_B = of[5] * w.y_A;
  }
};

// Impulses along the rows as they act on the two bodies.
struct Wrench {
  static constexpr int COUNT = 12;

  ALWAYS static void along(const Joints& at, const World& w, const Joints& by, const World& d, const Free& free,
                           Number* out) {
    const Number turn = (1.0 - free.turn) * at.torque[2], d_turn = (1.0 - free.turn) * by.torque[2];
    const Number pin = free.turn * at.torque[2], d_pin = free.turn * by.torque[2];
    const Vector push = pushed(w, at), tilt = tilted(w, at);
    const Vector d_push = pushed(d, at) + pushed(w, by), d_tilt = tilted(d, at) + tilted(w, by);
    const Vector about = turn * w.y_A, d_about = d_turn * w.y_A + turn * d.y_A;
    const Vector twist = cross(tilt, w.z_B) + cross(about, w.x_B);
    const Vector d_twist = cross(d_tilt, w.z_B) + cross(tilt, d.z_B) + cross(d_about, w.x_B) + cross(about, d.x_B);
    const Vector on_a = cross(push, w.lever) + twist, on_b = cross(w.arm_b, push) - twist;
    const Vector d_on_a = cross(d_push, w.lever) + cross(push, d.lever) + d_twist;
    const Vector d_on_b = cross(d.arm_b, push) + cross(w.arm_b, d_push) - d_twist;
    const Vector a = transposed_times(by.R_A, on_a) + transposed_times(at.R_A, d_on_a) - d_pin * at.F_A.column(2) -
                     pin * by.F_A.column(2);
    const Vector b = transposed_times(by.R_B, on_b) + transposed_times(at.R_B, d_on_b) + d_pin * at.F_B.column(2) +
                     pin * by.F_B.column(2);
    for (int i = 0; i < 3; ++i) out[i] = -d_push[i], out[3 + i] = a[i], out[6 + i] = d_push[i], out[9 + i] = b[i];
  }

  ALWAYS static void back(const Joints& at, const World& w, const Number* of, const Free& free, Joints& to,
                          World& back) {
    const Number turn = (1.0 - free.turn) * at.torque[2], pin = free.turn * at.torque[2];
    const Vector push = pushed(w, at), tilt = tilted(w, at), about = turn * w.y_A;
    const Vector twist = cross(tilt, w.z_B) + cross(about, w.x_B);
    const Vector of_a = {of[3], of[4], of[5]}, of_b = {of[9], of[10], of[11]};
    add_outer(cross(push, w.lever) + twist, of_a, to.R_A);
    add_outer(cross(w.arm_b, push) - twist, of_b, to.R_B);
    const Vector a = times(at.R_A, of_a), b = times(at.R_B, of_b), both = a - b;
    const Vector to_push = Vector{of[6] - of[0], of[7] - of[1], of[8] - of[2]} + cross(w.lever, a) + cross(b, w.arm_b);
    const Vector to_tilt = cross(w.z_B, both), to_about = cross(w.x_B, both);
    back.lever = cross(a, push);
    back.arm_b = cross(push, b);
    back.z_B = cross(both, tilt);
    back.x_B = cross(both, about);
    back.x_A = at.force[0] * to_push + at.torque[0] * to_tilt;
    back.y_A = at.force[1] * to_push + at.torque[1] * to_tilt + turn * to_about;
    back.z_A = at.force[2] * to_push;
    add_to_column(2, -(pin * of_a), to.F_A);
    add_to_column(2, pin * of_b, to.F_B);
    add({dot(w.x_A, to_push), dot(w.y_A, to_push), dot(w.z_A, to_push)}, to.force);
    const Number pinned = dot(at.F_B.column(2), of_b) - dot(at.F_A.column(2), of_a);
    add({dot(w.x_A, to_tilt), dot(w.y_A, to_tilt), free.turn * pinned + (1.0 - free.turn) * dot(w.y_A, to_about)},
        to.torque);
  }

 private:
  ALWAYS static Vector pushed(const World& w, const Joints& of) {
    return of.force[0] * w.x_A + of.force[1] * w.y_A + of.force[2] * w.z_A;
  }
  ALWAYS static Vector tilted(const World& w, const Joints& of) { return of.torque[0] * w.x_A + of.torque[1] * w.y_A; }
};

// The coordinate.
struct Coordinate {
  static constexpr int COUNT = 1;

  ALWAYS static void along(const Joints&, const World& w, const Joints&, const World& d, const Free& free, Number* out) {
    const Number sine = dot(w.y_A, w.x_B), cosine = dot(w.x_A, w.x_B);
    const Number d_sine = dot(d.y_A, w.x_B) + dot(w.y_A, d.x_B), d_cosine = dot(d.x_A, w.x_B) + dot(w.x_A, d.x_B);
    const Number turned = cosine * d_sine - sine * d_cosine;
    const Number slid = dot(d.z_A, w.lever - w.arm_a) + dot(w.z_A, d.lever - d.arm_a);
    *out = turned * share(free, sine, cosine) + free.slide * slid;
  }

  ALWAYS static void back(const Joints&, const World& w, const Number* of, const Free& free, Joints&, World& back) {
    const Number sine = dot(w.y_A, w.x_B), cosine = dot(w.x_A, w.x_B);
    const Number turned = *of * share(free, sine, cosine), slid = *of * free.slide;
    back.x_A = -(turned * sine) * w.x_B;
    back.y_A = turned * cosine * w.x_B;
    back.x_B = turned * cosine * w.y_A - turned * sine * w.x_A;
    back.z_A = slid * (w.lever - w.arm_a);
    back.lever = slid * w.z_A;
    back.arm_a = -(slid * w.z_A);
  }

 private:
  // No joint that does not turn is divided by.
  ALWAYS static Number share(const Free& free, const Number& sine, const Number& cosine) {
    return free.turn / (sine * sine + cosine * cosine + (1.0 - free.turn));
  }
};

enum Side { JOINT, BODY_A, BODY_B };

// Calls `with` with every part of some joints: the operand, whose part of it, and where in that.
template <class Call>
ALWAYS void parts(Joints& of, const Call& with) {
  with(POSITION, BODY_A, 0, of.x_A);
  with(POSITION, BODY_B, 0, of.x_B);
  for (int i = 0; i < 3; ++i) {
    with(ROTATION, BODY_A, 3 * i, of.R_A.row[i]);
    with(ROTATION, BODY_B, 3 * i, of.R_B.row[i]);
    with(AXES_A, JOINT, 3 * i, of.F_A.row[i]);
    with(AXES_B, JOINT, 3 * i, of.F_B.row[i]);
  }
  with(POINT_A, JOINT, 0, of.r_A);
  with(POINT_B, JOINT, 0, of.r_B);
  with(IMPULSES, JOINT, 0, of.force);
  with(IMPULSES, JOINT, 3, of.torque);
}

// Where each operand of one sample begins; nothing where it has no part.
struct Operands {
  const double* at[OPERANDS] = {};
};

// The joints of a system, some at a time; `first` is the first of them.
struct Group {
  const Slots &bodies, &does;
  int64_t first, count;

  // Calls `with` with each joint's lane, its two bodies and its number.
  template <class Call>
  ALWAYS void each(const Call& with) const {
    for (int64_t lane = 0; lane < count; ++lane) {
      const int64_t joint = first + lane;
      with(lane, bodies[2 * joint], bodies[2 * joint + 1], joint);
    }
  }

  Free free() const {
    Free made;
    each([&](int64_t lane, int64_t, int64_t, int64_t joint) {
      made.turn[lane] = does[joint] & TURNS ? 1.0 : 0.0;
      made.slide[lane] = does[joint] & SLIDES ? 1.0 : 0.0;
    });
    return made;
  }

  Joints load(const Operands& all) const {
    Joints made;
    each([&](int64_t lane, int64_t a, int64_t b, int64_t joint) {
      parts(made, [&](Operand of, Side side, int part, Vector& to) {
        if (!all.at[of]) return;
        const double* from = all.at[of] + (side == JOINT ? joint : side == BODY_A ? a : b) * SIZE[of] + part;
        for (int i = 0; i < 3; ++i) to[i][lane] = from[i];
      });
    });
    return made;
  }

  void add(Joints& made, double* const* all) const {
    each([&](int64_t lane, int64_t a, int64_t b, int64_t joint) {
      parts(made, [&](Operand of, Side side, int part, const Vector& from) {
        if (!all[of]) return;
        double* to = all[of] + (side == JOINT ? joint : side == BODY_A ? a : b) * SIZE[of] + part;
        for (int i = 0; i < 3; ++i) to[i] += from[i][lane];
      });
    });
  }
};

// Calls `with` with what is measured.
template <class Call>
void measured(int64_t numbers, const Call& with) {
  switch (numbers) {
    case Coordinate::COUNT: return with(Coordinate());
    case Value::COUNT: return with(Value());
    default: return with(Wrench());
  }
}

// Where the samples of each operand begin.
class Table {
 public:
  explicit Table(const std::vector<int64_t>& batch) : batch_(batch) {}
  void set(int operand, const Real& argument) {
    data_[operand] = argument.typed_data();
    samples_[operand].emplace(argument.dimensions(), DIMENSIONS[operand], batch_);
  }
  Operands operator()(int64_t sample) const {
    Operands all;
    for (int i = 0; i < OPERANDS; ++i)
      if (data_[i]) all.at[i] = data_[i] + (*samples_[i])(sample);
    return all;
  }

 private:
  const std::vector<int64_t>& batch_;
  const double* data_[OPERANDS] = {};
  std::optional<Samples> samples_[OPERANDS];
};

constexpr double MULTIPLICATIONS = 400.0;  // of a joint

// Arguments: the operands, all or all but the impulses; then the change of each that varies.
ffi::Error along(ffi::ThreadPool pool, ffi::RemainingArgs arguments, RealResult out, Slots bodies, Slots does,
                 Slots varied) {
  const auto batch = batch_of(out->dimensions(), 2);
  const int64_t joints = out->dimensions()[batch.size()], numbers = out->dimensions()[batch.size() + 1];
  const size_t operands = arguments.size() - varied.size();
  Table known(batch), changes(batch);
  for (size_t i = 0; i < operands; ++i) known.set(i, *arguments.get<Real>(i));
  for (size_t i = 0; i < varied.size(); ++i) changes.set(varied[i], *arguments.get<Real>(operands + i));
  measured(numbers, [&](auto measure) {
    spread(pool, count(batch), MULTIPLICATIONS * joints, [&](int64_t sample) {
      const Operands at = known(sample), by = changes(sample);
      double* to = out->typed_data() + sample * joints * numbers;
      for (int64_t first = 0; first < joints; first += LANES) {
        const Group group = {bodies, does, first, std::min<int64_t>(LANES, joints - first)};
        const Joints here = group.load(at), moved = group.load(by);
        Number found[measure.COUNT];
        measure.along(here, world(here), moved, change(here, moved), group.free(), found);
        for (int64_t lane = 0; lane < group.count; ++lane)
          for (int i = 0; i < measure.COUNT; ++i) to[(first + lane) * numbers + i] = found[i][lane];
      }
    });
  });
  return ffi::Error::Success();
}

// Arguments: the operands as above; then what a change of the measures is worth.  Results: what a change of each operand
// that varies is worth.
ffi::Error back(ffi::ThreadPool pool, ffi::RemainingArgs arguments, ffi::RemainingRets results, Slots bodies,
                Slots does, Slots varied) {
  const size_t operands = arguments.size() - 1;
  const Real of = *arguments.get<Real>(operands);
  const auto batch = batch_of((*results.get<ffi::Buffer<ffi::F64>>(0))->dimensions(), DIMENSIONS[varied[0]]);
  const int64_t joints = of.dimensions()[batch.size()], numbers = of.dimensions()[batch.size() + 1];
  Table known(batch);
  for (size_t i = 0; i < operands; ++i) known.set(i, *arguments.get<Real>(i));
  const Samples of_worth(of.dimensions(), 2, batch);
  double* out[OPERANDS] = {};
  int64_t size[OPERANDS] = {};
  for (size_t i = 0; i < varied.size(); ++i) {
    RealResult result = *results.get<ffi::Buffer<ffi::F64>>(i);
    out[varied[i]] = result->typed_data();
    size[varied[i]] = result->dimensions()[batch.size()] * SIZE[varied[i]];
  }
  measured(numbers, [&](auto measure) {
    spread(pool, count(batch), MULTIPLICATIONS * joints, [&](int64_t sample) {
      const Operands at = known(sample);
      const double* worth = of.typed_data() + of_worth(sample);
      double* to[OPERANDS] = {};
      for (int i = 0; i < OPERANDS; ++i)
        if (out[i]) std::fill_n(to[i] = out[i] + sample * size[i], size[i], 0.0);
      for (int64_t first = 0; first < joints; first += LANES) {
        const Group group = {bodies, does, first, std::min<int64_t>(LANES, joints - first)};
        const Joints here = group.load(at);
        Number given[measure.COUNT] = {};
        for (int64_t lane = 0; lane < group.count; ++lane)
          for (int i = 0; i < measure.COUNT; ++i) given[i][lane] = worth[(first + lane) * numbers + i];
        Joints sent;
        World sent_on;
        measure.back(here, world(here), given, group.free(), sent, sent_on);
        send_back(here, sent_on, sent);
        group.add(sent, to);
      }
    });
  });
  return ffi::Error::Success();
}

}  // namespace

XLA_FFI_DEFINE_HANDLER_SYMBOL(JointSlopes, along,
                              ffi::Ffi::Bind()
                                  .Ctx<ffi::ThreadPool>()
                                  .RemainingArgs()
                                  .Ret<Real>()
                                  .Attr<Slots>("bodies")
                                  .Attr<Slots>("does")
                                  .Attr<Slots>("varied"));

XLA_FFI_DEFINE_HANDLER_SYMBOL(JointSlopesTransposed, back,
                              ffi::Ffi::Bind()
                                  .Ctx<ffi::ThreadPool>()
                                  .RemainingArgs()
                                  .RemainingRets()
                                  .Attr<Slots>("bodies")
                                  .Attr<Slots>("does")
                                  .Attr<Slots>("varied"));
