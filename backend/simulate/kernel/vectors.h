// Vectors of three numbers and 3 x 3 matrices, of several joints at once: a number is one lane for each of them.

#pragma once

#include <cstdint>

namespace {

constexpr int LANES = 8;
typedef double Number __attribute__((vector_size(8 * LANES)));

struct Vector {
  Number at[3] = {};
  const Number& operator[](int i) const { return at[i]; }
  Number& operator[](int i) { return at[i]; }
};

struct Matrix {
  Vector row[3] = {};
  Vector column(int k) const { return {row[0][k], row[1][k], row[2][k]}; }
};

#define ALWAYS inline __attribute__((always_inline))

ALWAYS Vector operator+(const Vector& u, const Vector& v) { return {u[0] + v[0], u[1] + v[1], u[2] + v[2]}; }
ALWAYS Vector operator-(const Vector& u, const Vector& v) { return {u[0] - v[0], u[1] - v[1], u[2] - v[2]}; }
ALWAYS Vector operator-(const Vector& v) { return {-v[0], -v[1], -v[2]}; }
ALWAYS Vector operator*(const Number& s, const Vector& v) { return {s * v[0], s * v[1], s * v[2]}; }

ALWAYS Number dot(const Vector& u, const Vector& v) { return u[0] * v[0] + u[1] * v[1] + u[2] * v[2]; }

ALWAYS Vector cross(const Vector& u, const Vector& v) {
  return {u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]};
}

ALWAYS Vector times(const Matrix& m, const Vector& v) { return {dot(m.row[0], v), dot(m.row[1], v), dot(m.row[2], v)}; }

ALWAYS Vector transposed_times(const Matrix& m, const Vector& v) {
  return v[0] * m.row[0] + v[1] * m.row[1] + v[2] * m.row[2];
}

ALWAYS void add(const Vector& by, Vector& v) { v = v + by; }

ALWAYS void add_to_column(int k, const Vector& by, Matrix& m) {
  for (int i = 0; i < 3; ++i) m.row[i][k] += by[i];
}

// m += u v^T
ALWAYS void add_outer(const Vector& u, const Vector& v, Matrix& m) {
  for (int i = 0; i < 3; ++i) m.row[i] = m.row[i] + u[i] * v;
}

}  // namespace
