// The compiled twin of `rows` in backend/simulate/kinematics.py: the six rows of every joint and their Jacobian.

#include <array>

#include "batches.h"

namespace {

constexpr int ROWS = 6, PAIR = 12;

using Vector = std::array<double, 3>;

// A 3 x 3 matrix by its columns.
struct Matrix {
  Vector column[3];
  explicit Matrix(const double* row_major) {
    for (int i = 0; i < 3; ++i)
      for (int k = 0; k < 3; ++k) column[k][i] = row_major[3 * i + k];
  }
};

inline Vector cross(const Vector& u, const Vector& v) {
  return {u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]};
}

inline double dot(const Vector& u, const Vector& v) { return u[0] * v[0] + u[1] * v[1] + u[2] * v[2]; }

inline Vector times(const Matrix& m, const Vector& v) {
  Vector out;
  for (int i = 0; i < 3; ++i) out[i] = m.column[0][i] * v[0] + m.column[1][i] * v[1] + m.column[2][i] * v[2];
  return out;
}

inline Vector transposed_times(const Matrix& m, const Vector& v) {
  return {dot(m.column[0], v), dot(m.column[1], v), dot(m.column[2], v)};
}

inline Vector load(const double* from) { return {from[0], from[1], from[2]}; }

inline void store(const Vector& v, double* to) {
  for (int i = 0; i < 3; ++i) to[i] = v[i];
}

// Everything of one joint; positions are of centres of mass, points relative to them in body axes.
struct Joint {
  const double *position_a, *position_b, *rotation_a, *rotation_b, *axes_a, *axes_b, *point_a, *point_b;
};

void rows_of(const Joint& at, bool turns_freely, double* value, double* jacobian) {
  const Matrix R_WA(at.rotation_a), R_WB(at.rotation_b), F_A(at.axes_a), F_B(at.axes_b);
  const Vector r_A = load(at.point_a), r_B = load(at.point_b);
  const Vector arm = times(R_WB, r_B);
  Vector p_W, p_AP;
  for (int i = 0; i < 3; ++i) p_W[i] = at.position_b[i] + arm[i] - at.position_a[i];
  p_AP = transposed_times(R_WA, p_W);
  Vector past_A;
  for (int i = 0; i < 3; ++i) past_A[i] = p_AP[i] - r_A[i];

  Vector in_B[3];  // the axes of frame A in body B's axes
  for (int i = 0; i < 3; ++i) {
    const Vector axis_W = times(R_WA, F_A.column[i]);
    in_B[i] = transposed_times(R_WB, axis_W);
    value[i] = dot(F_A.column[i], past_A);
    double* row = jacobian + i * PAIR;
    store({-axis_W[0], -axis_W[1], -axis_W[2]}, row);
    store(cross(F_A.column[i], p_AP), row + 3);
    store(axis_W, row + 6);
    store(cross(r_B, in_B[i]), row + 9);
  }

  const Vector x_A = transposed_times(R_WA, times(R_WB, F_B.column[0]));
  const Vector z_A = transposed_times(R_WA, times(R_WB, F_B.column[2]));
  value[3] = dot(F_A.column[0], z_A);
  value[4] = dot(F_A.column[1], z_A);
  value[5] = dot(F_A.column[1], x_A);
  const Vector& z_of_A = F_A.column[2];
  const Vector on_a[3] = {
      cross(F_A.column[0], z_A), cross(F_A.column[1], z_A),
      turns_freely ? Vector{-z_of_A[0], -z_of_A[1], -z_of_A[2]} : cross(F_A.column[1], x_A)};
  const Vector on_b[3] = {cross(F_B.column[2], in_B[0]), cross(F_B.column[2], in_B[1]),
                          turns_freely ? F_B.column[2] : cross(F_B.column[0], in_B[1])};
  for (int i = 0; i < 3; ++i) {
    double* row = jacobian + (3 + i) * PAIR;
    store({}, row);
    store(on_a[i], row + 3);
    store({}, row + 6);
    store(on_b[i], row + 9);
  }
}

ffi::Error joint_rows(ffi::ThreadPool pool, Real position, Real rotation, Real axes_a, Real axes_b, Real point_a,
                      Real point_b, RealResult value, RealResult jacobian, Slots bodies, Slots turns_freely) {
  const auto batch = batch_of(value->dimensions(), 2);
  const int64_t joints = value->dimensions()[batch.size()];
  if (static_cast<int64_t>(bodies.size()) != 2 * joints || static_cast<int64_t>(turns_freely.size()) != joints)
    return ffi::Error::InvalidArgument("joint_rows: a joint lacks its two bodies, or whether it turns freely");
  const Samples of_position(position.dimensions(), 2, batch), of_rotation(rotation.dimensions(), 3, batch),
      of_axes_a(axes_a.dimensions(), 3, batch), of_axes_b(axes_b.dimensions(), 3, batch),
      of_point_a(point_a.dimensions(), 2, batch), of_point_b(point_b.dimensions(), 2, batch);
  spread(pool, count(batch), 400.0 * joints, [&](int64_t sample) {
    const double *x = position.typed_data() + of_position(sample), *R = rotation.typed_data() + of_rotation(sample),
                 *F_A = axes_a.typed_data() + of_axes_a(sample), *F_B = axes_b.typed_data() + of_axes_b(sample),
                 *r_A = point_a.typed_data() + of_point_a(sample), *r_B = point_b.typed_data() + of_point_b(sample);
    double *y = value->typed_data() + sample * joints * ROWS,
           *slope = jacobian->typed_data() + sample * joints * ROWS * PAIR;
    for (int64_t joint = 0; joint < joints; ++joint) {
      const int64_t a = bodies[2 * joint], b = bodies[2 * joint + 1];
      rows_of({x + 3 * a, x + 3 * b, R + 9 * a, R + 9 * b, F_A + 9 * joint, F_B + 9 * joint, r_A + 3 * joint,
               r_B + 3 * joint},
              turns_freely[joint] != 0, y + joint * ROWS, slope + joint * ROWS * PAIR);
    }
  });
  return ffi::Error::Success();
}

}  // namespace

XLA_FFI_DEFINE_HANDLER_SYMBOL(JointRows, joint_rows,
                              ffi::Ffi::Bind()
                                  .Ctx<ffi::ThreadPool>()
                                  .Arg<Real>()
                                  .Arg<Real>()
                                  .Arg<Real>()
                                  .Arg<Real>()
                                  .Arg<Real>()
                                  .Arg<Real>()
                                  .Ret<Real>()
                                  .Ret<Real>()
                                  .Attr<Slots>("bodies")
                                  .Attr<Slots>("turns_freely"));
