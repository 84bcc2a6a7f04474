// The 4-mode IMM of unscented filters on the quarter car, written for speed: the practical limit.
//
// Lanes are runs: one SIMD register holds one entry of W runs, so every line below is a vector
// operation. A batch of fewer runs than a register is worth puts the modes in the lanes instead.
// The same work as the library's filter: mixing with the spread of the means, a guarded Cholesky
// factor, points drawn before and after the prediction, RK4, the road noise integrated with each
// mode's own stiffness, a sum-of-squares update, mode probabilities in log space. Left out: NaN
// measurements, flags, and the restart of a member that has failed.

#include <atomic>
#include <cmath>
#include <cstdint>
#include <limits>
#include <thread>
#include <type_traits>
#include <vector>

namespace {

#if defined(__AVX512F__)
constexpr int BYTES = 64;
#elif defined(__AVX__)
constexpr int BYTES = 32;
#else
constexpr int BYTES = 16;
#endif

constexpr int N = 5;              // states
constexpr int M = 4;              // modes
constexpr int P = N * (N + 1) / 2;  // entries of a lower triangle
constexpr int OUT = N + M + 1;    // mean, log probabilities, log-likelihood

constexpr int at(int i, int j) { return i * (i + 1) / 2 + j; }

template <class T, int W>
struct Pack {
  using Int = std::conditional_t<sizeof(T) == 4, int32_t, int64_t>;
  typedef T V __attribute__((vector_size(W * sizeof(T))));
  typedef Int I __attribute__((vector_size(W * sizeof(T))));
  typedef int32_t I32 __attribute__((vector_size(W * 4)));

  static V all(T a) { return V{} + a; }

  static V sqrt(V x) {
    V y;
    for (int l = 0; l < W; ++l) y[l] = std::sqrt(x[l]);
    return y;
  }

  static V magnitude(V x) { return (V)((I)x & std::numeric_limits<Int>::max()); }

  static V exp(V x) {
    constexpr bool single = sizeof(T) == 4;
    constexpr int mantissa = single ? 23 : 52, bias = single ? 127 : 1023;
    constexpr int degree = single ? 7 : 13;
    const V lowest = all(single ? T(-87) : T(-708));
    x = x < lowest ? lowest : x;
    // positive with the bias, so truncation rounds to nearest
    const I32 biased = __builtin_convertvector(x * T(1.4426950408889634) + (bias + T(0.5)), I32);
    const V whole = __builtin_convertvector(biased, V) - T(bias);
    const V r = (x - whole * T(0.693359375)) + whole * T(2.1219444005469058277e-4);
    T coefficient[degree + 1] = {T(1)};
    for (int k = 1; k <= degree; ++k) coefficient[k] = coefficient[k - 1] / T(k);
    V sum = all(coefficient[degree]);
    for (int k = degree - 1; k >= 0; --k) sum = sum * r + coefficient[k];
    return sum * (V)(__builtin_convertvector(biased, I) << mantissa);
  }

  // of positive normal numbers
  static V log(V x) {
    constexpr bool single = sizeof(T) == 4;
    constexpr int mantissa = single ? 23 : 52, bias = single ? 127 : 1023;
    constexpr int terms = single ? 5 : 11;
    const Int mask = (Int(1) << mantissa) - 1;
    I exponent = ((I)x >> mantissa) - Int(bias);
    V m = (V)(((I)x & mask) | (Int(bias) << mantissa));
    const I high = (I)(m > T(1.4142135623730951));
    m = high ? m * T(0.5) : m;
    exponent = exponent - high;
    const V e = __builtin_convertvector(__builtin_convertvector(exponent, I32), V);
    const V s = (m - T(1)) / (m + T(1));
    const V square = s * s;
    V sum = all(T(1) / T(2 * terms - 1));
    for (int k = terms - 2; k >= 0; --k) sum = sum * square + T(1) / T(2 * k + 1);
    return T(2) * s * sum + e * T(0.6931471805599453);
  }
};

template <class T>
struct Problem {
  T m_s, m_u, k_s, k_nl, c_s, c_nl, dt, noise, stiffness_walk, velocity_walk;
  T intensity[M], mean[N], cov[P], transition[M][M], initial[M];

  explicit Problem(const double* from) {
    T* to = reinterpret_cast<T*>(this);
    for (std::size_t i = 0; i < sizeof(*this) / sizeof(T); ++i) to[i] = T(from[i]);
  }
};

template <class V>
struct Belief {
  V mean[N], cov[P];
};

template <class T, int W>
struct Member {
  using K = Pack<T, W>;
  using V = typename K::V;
  const Problem<T>& p;

  void derivative(const V* x, V k_t, V* slope) const {
    const V w = x[2] - x[3];
    const V force = x[0] * (p.k_s + p.k_nl * x[0] * x[0]) + w * (p.c_s + p.c_nl * K::magnitude(w));
    slope[0] = w;
    slope[1] = x[3];
    slope[2] = force * (T(-1) / p.m_s);
    slope[3] = (force - k_t * x[1]) * (T(1) / p.m_u);
  }

  void transition(const V* x, V* next) const {
    const V k_t = K::exp(x[4]);
    V k1[4], k2[4], k3[4], k4[4], s[4];
    derivative(x, k_t, k1);
    for (int i = 0; i < 4; ++i) s[i] = x[i] + (T(0.5) * p.dt) * k1[i];
    derivative(s, k_t, k2);
    for (int i = 0; i < 4; ++i) s[i] = x[i] + (T(0.5) * p.dt) * k2[i];
    derivative(s, k_t, k3);
    for (int i = 0; i < 4; ++i) s[i] = x[i] + p.dt * k3[i];
    derivative(s, k_t, k4);
    for (int i = 0; i < 4; ++i)
      next[i] = x[i] + (p.dt / T(6)) * (k1[i] + k4[i] + T(2) * (k2[i] + k3[i]));
    next[4] = x[4];
  }

  void observation(const V* x, V* y) const {
    V slope[4];
    derivative(x, K::exp(x[4]), slope);
    y[0] = slope[2];
    y[1] = slope[3];
  }

  // covariance of the relative state from a road that is white in velocity, added to `cov`
  void add_process_cov(V ln_k_t, V intensity, V* cov) const {
    const V k_t = K::exp(ln_k_t);
    V power[5][4] = {{V{}, K::all(T(1)), V{}, V{}}};
    for (int k = 0; k < 4; ++k) {
      const V* h = power[k];
      const V w = h[2] - h[3], force = p.k_s * h[0] + p.c_s * w;
      const T step = p.dt / T(k + 1);
      power[k + 1][0] = step * w;
      power[k + 1][1] = step * h[3];
      power[k + 1][2] = (-step / p.m_s) * force;
      power[k + 1][3] = (step / p.m_u) * (force - k_t * h[1]);
    }
    const T offset = std::sqrt(T(0.15));
    const T node[3] = {T(0.5) - offset, T(0.5), T(0.5) + offset};
    const T weight[3] = {T(5) / T(18), T(8) / T(18), T(5) / T(18)};
    for (int q = 0; q < 3; ++q) {
      V h[4];
      for (int i = 0; i < 4; ++i) {
        h[i] = power[4][i];
        for (int k = 3; k >= 0; --k) h[i] = h[i] * node[q] + power[k][i];
      }
      const V scale = intensity * (p.dt * weight[q]);
      for (int i = 0; i < 4; ++i)
        for (int j = 0; j <= i; ++j) cov[at(i, j)] += scale * h[i] * h[j];
    }
    cov[at(2, 2)] += p.velocity_walk;
    cov[at(3, 3)] += p.velocity_walk;
    cov[at(4, 4)] += p.stiffness_walk;
  }

  // factor with the pivots and their inverses apart; a pivot below a relative guard is raised
  template <int n>
  static void cholesky(const V* a, V* factor, V* inverse) {
    const T guard = T(64) * std::numeric_limits<T>::epsilon();
    for (int j = 0; j < n; ++j) {
      V pivot = a[at(j, j)];
      const V floor = guard * pivot;
      for (int k = 0; k < j; ++k) pivot -= factor[at(j, k)] * factor[at(j, k)];
      pivot = pivot < floor ? floor : pivot;
      factor[at(j, j)] = K::sqrt(pivot);
      inverse[j] = T(1) / factor[at(j, j)];
      for (int i = j + 1; i < n; ++i) {
        V entry = a[at(i, j)];
        for (int k = 0; k < j; ++k) entry -= factor[at(i, k)] * factor[at(j, k)];
        factor[at(i, j)] = entry * inverse[j];
      }
    }
  }

  // mean, odd part and even part of a function of the 2 N cubature points
  template <int rows, class Function>
  static void transform(Function function, const V* x, const V* factor, V* mean, V (*odd)[N],
                        V (*even)[N]) {
    const T spread = std::sqrt(T(N)), scale = std::sqrt(T(1) / T(N));
    for (int j = 0; j < N; ++j) {
      V up[N], down[N], f_up[rows], f_down[rows];
      for (int i = 0; i < N; ++i) {
        up[i] = i < j ? x[i] : x[i] + spread * factor[at(i, j)];
        down[i] = i < j ? x[i] : x[i] - spread * factor[at(i, j)];
      }
      function(up, f_up);
      function(down, f_down);
      for (int k = 0; k < rows; ++k) {
        odd[k][j] = (T(0.5) * scale) * (f_up[k] - f_down[k]);
        even[k][j] = f_up[k] + f_down[k];
      }
    }
    for (int k = 0; k < rows; ++k) {
      mean[k] = even[k][0];
      for (int j = 1; j < N; ++j) mean[k] += even[k][j];
      mean[k] *= T(0.5) / T(N);
      for (int j = 0; j < N; ++j) even[k][j] = scale * (T(0.5) * even[k][j] - mean[k]);
    }
  }

  // the belief a sample later; returns log p(y | past)
  V step(Belief<V>& b, const V* y, V intensity) const {
    V factor[P], inverse[N], mean[N], odd[N][N], even[N][N], cov[P];
    cholesky<N>(b.cov, factor, inverse);
    transform<N>([this](const V* x, V* f) { transition(x, f); }, b.mean, factor, mean, odd, even);
    for (int i = 0; i < N; ++i)
      for (int j = 0; j <= i; ++j) {
        V sum = odd[i][0] * odd[j][0] + even[i][0] * even[j][0];
        for (int k = 1; k < N; ++k) sum += odd[i][k] * odd[j][k] + even[i][k] * even[j][k];
        cov[at(i, j)] = sum;
      }
    add_process_cov(b.mean[4], intensity, cov);

    V h[2], g[2][N], e[2][N];
    cholesky<N>(cov, factor, inverse);
    transform<2>([this](const V* x, V* f) { observation(x, f); }, mean, factor, h, g, e);
    V noise[3] = {K::all(p.noise), V{}, K::all(p.noise)}, innovation_cov[3];
    for (int i = 0; i < 2; ++i)
      for (int j = 0; j <= i; ++j) {
        for (int k = 0; k < N; ++k) noise[at(i, j)] += e[i][k] * e[j][k];
        innovation_cov[at(i, j)] = noise[at(i, j)];
        for (int k = 0; k < N; ++k) innovation_cov[at(i, j)] += g[i][k] * g[j][k];
      }
    V root[3], root_inverse[2], noise_root[3], unused[2];
    cholesky<2>(innovation_cov, root, root_inverse);
    cholesky<2>(noise, noise_root, unused);
    const V innovation[2] = {y[0] - h[0], y[1] - h[1]};
    V kept[N][N + 2];
    for (int i = 0; i < N; ++i) {
      V cross[2] = {};
      for (int c = 0; c < 2; ++c)
        for (int k = 0; k <= i; ++k) cross[c] += factor[at(i, k)] * g[c][k];
      const V first = cross[0] * root_inverse[0];
      const V gain1 = (cross[1] - root[1] * first) * root_inverse[1] * root_inverse[1];
      const V gain0 = (first - root[1] * gain1) * root_inverse[0];
      b.mean[i] = mean[i] + gain0 * innovation[0] + gain1 * innovation[1];
      for (int k = 0; k < N; ++k) {
        kept[i][k] = -(gain0 * g[0][k] + gain1 * g[1][k]);
        if (k <= i) kept[i][k] += factor[at(i, k)];
      }
      kept[i][N] = gain0 * noise_root[0] + gain1 * noise_root[1];
      kept[i][N + 1] = gain1 * noise_root[2];
      for (int j = 0; j <= i; ++j) {
        V sum = kept[i][0] * kept[j][0];
        for (int k = 1; k < N + 2; ++k) sum += kept[i][k] * kept[j][k];
        b.cov[at(i, j)] = sum;
      }
    }
    const V white0 = innovation[0] * root_inverse[0];
    const V white1 = (innovation[1] - root[1] * white0) * root_inverse[1];
    return T(-0.5) * (white0 * white0 + white1 * white1) - K::log(root[0] * root[2]) -
           T(1.8378770664093453);
  }
};

// moment-matched mixture; X is V, or a scalar where the modes are the lanes of V
template <class V, class X>
void mix(const V* weight, const Belief<X>* members, Belief<V>& mixed) {
  for (int a = 0; a < N; ++a) {
    mixed.mean[a] = weight[0] * members[0].mean[a];
    for (int i = 1; i < M; ++i) mixed.mean[a] += weight[i] * members[i].mean[a];
  }
  for (int c = 0; c < P; ++c) mixed.cov[c] = V{};
  for (int i = 0; i < M; ++i) {
    V spread[N];
    for (int a = 0; a < N; ++a) spread[a] = members[i].mean[a] - mixed.mean[a];
    for (int a = 0; a < N; ++a)
      for (int c = 0; c <= a; ++c)
        mixed.cov[at(a, c)] += weight[i] * (members[i].cov[at(a, c)] + spread[a] * spread[c]);
  }
}

// W runs at once, lanes = runs; out [samples, OUT, stride]
template <class T>
void run_block(const Problem<T>& p, const T* ys, T* out, int first, int count, int samples,
               int stride) {
  constexpr int W = BYTES / sizeof(T);
  using K = Pack<T, W>;
  using V = typename K::V;
  const Member<T, W> member{p};
  Belief<V> members[M], mixed[M];
  V probability[M];
  const T* record[W];
  for (int l = 0; l < W; ++l)
    record[l] = ys + 2 * std::size_t(samples) * (first + (l < count ? l : count - 1));
  for (int m = 0; m < M; ++m) {
    for (int a = 0; a < N; ++a) members[m].mean[a] = K::all(p.mean[a]);
    for (int c = 0; c < P; ++c) members[m].cov[c] = K::all(p.cov[c]);
    probability[m] = K::all(p.initial[m]);
  }
  for (int t = 0; t < samples; ++t) {
    V y[2] = {};
    for (int l = 0; l < W; ++l) {
      y[0][l] = record[l][2 * t];
      y[1][l] = record[l][2 * t + 1];
    }
    V joint[M];
    for (int j = 0; j < M; ++j) {
      V weight[M], total = V{};
      for (int i = 0; i < M; ++i) total += weight[i] = p.transition[i][j] * probability[i];
      const V inverse = T(1) / total;
      for (int i = 0; i < M; ++i) weight[i] *= inverse;
      joint[j] = K::log(total);
      mix(weight, members, mixed[j]);
    }
    for (int j = 0; j < M; ++j) {
      members[j] = mixed[j];
      joint[j] += member.step(members[j], y, K::all(p.intensity[j]));
    }
    V top = joint[0];
    for (int j = 1; j < M; ++j) top = joint[j] > top ? joint[j] : top;
    V total = V{};
    for (int j = 0; j < M; ++j) total += probability[j] = K::exp(joint[j] - top);
    const V inverse = T(1) / total, log_likelihood = top + K::log(total);
    for (int j = 0; j < M; ++j) probability[j] *= inverse;

    T* row = out + std::size_t(t) * OUT * stride + first;
    for (int a = 0; a < N; ++a) {
      V sum = probability[0] * members[0].mean[a];
      for (int j = 1; j < M; ++j) sum += probability[j] * members[j].mean[a];
      *reinterpret_cast<V*>(row + a * stride) = sum;
    }
    for (int j = 0; j < M; ++j)
      *reinterpret_cast<V*>(row + (N + j) * stride) = joint[j] - log_likelihood;
    *reinterpret_cast<V*>(row + (N + M) * stride) = log_likelihood;
  }
}

// one run, lanes = modes
template <class T>
void run_one(const Problem<T>& p, const T* ys, T* out, int run, int samples, int stride) {
  using K = Pack<T, M>;
  using V = typename K::V;
  const Member<T, M> member{p};
  Belief<V> belief;
  V probability, intensity, transition[M];
  for (int a = 0; a < N; ++a) belief.mean[a] = K::all(p.mean[a]);
  for (int c = 0; c < P; ++c) belief.cov[c] = K::all(p.cov[c]);
  for (int j = 0; j < M; ++j) {
    probability[j] = p.initial[j];
    intensity[j] = p.intensity[j];
    for (int i = 0; i < M; ++i) transition[i][j] = p.transition[i][j];
  }
  for (int t = 0; t < samples; ++t) {
    Belief<T> members[M];
    for (int i = 0; i < M; ++i) {
      for (int a = 0; a < N; ++a) members[i].mean[a] = belief.mean[a][i];
      for (int c = 0; c < P; ++c) members[i].cov[c] = belief.cov[c][i];
    }
    V weight[M], predicted = V{};
    for (int i = 0; i < M; ++i) predicted += weight[i] = transition[i] * T(probability[i]);
    const V reciprocal = T(1) / predicted;
    for (int i = 0; i < M; ++i) weight[i] *= reciprocal;
    mix(weight, members, belief);
    const T* sample = ys + 2 * (std::size_t(samples) * run + t);
    const V y[2] = {K::all(sample[0]), K::all(sample[1])};
    const V joint = K::log(predicted) + member.step(belief, y, intensity);
    T top = joint[0];
    for (int j = 1; j < M; ++j) top = joint[j] > top ? joint[j] : top;
    probability = K::exp(joint - top);
    T total = 0;
    for (int j = 0; j < M; ++j) total += probability[j];
    probability /= total;
    const T log_likelihood = top + std::log(total);

    T* row = out + std::size_t(t) * OUT * stride + run;
    for (int a = 0; a < N; ++a) {
      const V product = probability * belief.mean[a];
      T sum = 0;
      for (int j = 0; j < M; ++j) sum += product[j];
      row[a * stride] = sum;
    }
    for (int j = 0; j < M; ++j) row[(N + j) * stride] = joint[j] - log_likelihood;
    row[(N + M) * stride] = log_likelihood;
  }
}

template <class T>
void run_all(const double* numbers, const T* ys, T* out, int runs, int samples, int stride,
             int threads) {
  constexpr int W = BYTES / sizeof(T);
  const Problem<T> p(numbers);
  const int blocks = (runs + W - 1) / W;
  std::atomic<int> next{0};
  const auto work = [&] {
    for (int block; (block = next++) < blocks;) {
      const int first = block * W, count = runs - first < W ? runs - first : W;
      if (count > 5)
        run_block(p, ys, out, first, count, samples, stride);
      else
        for (int l = 0; l < count; ++l) run_one(p, ys, out, first + l, samples, stride);
    }
  };
  std::vector<std::thread> others;
  for (int k = 1; k < threads && k < blocks; ++k) others.emplace_back(work);
  work();
  for (std::thread& other : others) other.join();
}

}  // namespace

// stride: runs rounded up to a multiple of 16; out is aligned to 64 bytes
extern "C" void immuf_float32(const double* problem, const float* ys, float* out, int runs,
                              int samples, int stride, int threads) {
  run_all(problem, ys, out, runs, samples, stride, threads);
}

extern "C" void immuf_float64(const double* problem, const double* ys, double* out, int runs,
                              int samples, int stride, int threads) {
  run_all(problem, ys, out, runs, samples, stride, threads);
}
