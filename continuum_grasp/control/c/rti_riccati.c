/* Riccati recursion: the QP without bounds, and Newton steps of the QP with bounds.
 *
 * A Newton step of a bounded QP is an unbounded QP with weights on its bounded quantities, so both have the structure
 * of a linear-quadratic regulator, which the recursion solves in O(RTI_N) (C. V. Rao, S. J. Wright, J. B. Rawlings, J.
 * Optim. Theory Appl. 99 (1998) 723, doi:10.1023/A:1021711402723).
 *
 * Bounded quantities are the inputs, then the rows of c. Entry k of one is its value at node k, or at node k + 1 if it
 * is a row of the state alone; entries from RTI_N on (padding) repeat the last one. Rows come from three generated
 * functions, which skip the zeros of C:
 *   rti_row_values(c, C, z, y)    y = c + C z
 *   rti_row_gradient(C, w, q)     q += C' w
 *   rti_row_hessian(C, W, G)      G += C' diag(W) C, its lower triangle
 * and products with the matrices of a stage from three more:
 *   rti_add_hessian(q, H, z)      q += H z
 *   rti_add_transposed(q, M, p)   q += M' p
 *   rti_following(next, M, z)     next += M z
 */

#ifndef RTI_UNROLLED_CONGRUENCE /* else written out for the sparsity of the problem */
/* G = H + M' P M, of the symmetric ones their lower triangles */
static inline void rti_congruence(real (*G)[RTI_W], real (*H)[RTI_W], real (*P)[RTI_W], real (*M)[RTI_W])
{
  real PM[RTI_NX][RTI_W];
  for (int i = 0; i < RTI_NX; ++i) {
    real row[RTI_W] = {0};
    for (int q = 0; q < RTI_NX; ++q) {
      const real p = i < q ? P[q][i] : P[i][q];
      for (int l = 0; l < RTI_W; ++l) row[l] += p * M[q][l];
    }
    memcpy(PM[i], row, sizeof row);
  }
  for (int j = 0; j < RTI_NZ; ++j) {
    real row[RTI_W];
    memcpy(row, H[j], sizeof row);
    for (int i = 0; i < RTI_NX; ++i)
      for (int l = 0; l < RTI_W; ++l) row[l] += M[i][j] * PM[i][l];
    memcpy(G[j], row, sizeof row);
  }
}
#endif

/* Minimize over the inputs one by one, last first: u_j = K_j [x, u_0 .. u_j-1]; what remains in the lower triangle is
 * the Hessian of the state. An input whose pivot is rounding (8 eps of its diagonal) has no effect and stays; dividing by
 * it would blow up. */
static inline void rti_eliminate(real (*G)[RTI_W], real (*K)[RTI_W], real inverse[RTI_NU])
{
  real least[RTI_NU];
  for (int j = 0; j < RTI_NU; ++j) least[j] = 8 * RTI_EPS * G[RTI_NX + j][RTI_NX + j];
  for (int j = RTI_NU - 1; j >= 0; --j) {
    const int v = RTI_NX + j;
    inverse[j] = G[v][v] > least[j] ? 1 / G[v][v] : 0;
    for (int l = 0; l < RTI_W; ++l) K[j][l] = l < v ? -G[v][l] * inverse[j] : 0;
    for (int i = 0; i < v; ++i) rti_add_row(G[i], G[v][i], K[j], i + 1);
  }
}

/* The same for the gradient, which gives the constant part of the inputs. */
static inline void rti_eliminate_gradient(real q[RTI_W], real (*K)[RTI_W], const real inverse[RTI_NU],
    real constant[RTI_NU])
{
  for (int j = RTI_NU - 1; j >= 0; --j) {
    const real pull = q[RTI_NX + j];
    constant[j] = -pull * inverse[j];
    for (int l = 0; l < RTI_NX + j; ++l) q[l] += K[j][l] * pull;
  }
}

static inline void rti_inputs(real z[RTI_W], real (*K)[RTI_W], const real constant[RTI_NU])
{
  for (int j = 0; j < RTI_NU; ++j) {
    real u = constant[j];
    for (int l = 0; l < RTI_NX + j; ++l) u += K[j][l] * z[l];
    z[RTI_NX + j] = u;
  }
}

#ifdef RTI_ROBUST
/* Scenarios have their first node and its inputs in common: each leaves the Hessian and the gradient there that its later
 * stages add up to, and the inputs of their sum are eliminated once. */

/* The average of the scenarios' first nodes and inputs, which a shifted plan has no longer in common. */
static void rti_share(rti_work *o, const rti_settings *s)
{
  for (int i = 0; i < RTI_NX; ++i) {
    real sum = 0;
    for (int b = 0; b < RTI_SCENARIOS; ++b) sum += o->x[b * (RTI_N + 1)][i];
    for (int b = 0; b < RTI_SCENARIOS; ++b) o->x[b * (RTI_N + 1)][i] = sum / RTI_SCENARIOS;
  }
  for (int j = 0; j < RTI_NU; ++j) {
    real sum = 0;
    for (int b = 0; b < RTI_SCENARIOS; ++b) sum += o->u[b * RTI_N][j];
    sum = rti_max(s->u_min[j], rti_min(s->u_max[j], sum / RTI_SCENARIOS));
    for (int b = 0; b < RTI_SCENARIOS; ++b) o->u[b * RTI_N][j] = sum;
  }
}

/* Add what the scenarios before have left at the first node; whether that is the sum of all. */
static inline int rti_add_scenario(int b, real (*G)[RTI_W], real (*sum)[RTI_W])
{
  for (int i = 0; i < RTI_NZ && b > 0; ++i) rti_add_row(G[i], 1, sum[i], i + 1);
  memcpy(sum, G, RTI_NZ * sizeof *sum);
  return b == RTI_SCENARIOS - 1;
}

/* Copy the feedback of the common inputs from the last scenario, which has the sum, to the others. */
static void rti_copy_feedback(rti_work *o)
{
  const int last = (RTI_SCENARIOS - 1) * RTI_N;
  for (int b = 0; b < RTI_SCENARIOS - 1; ++b) {
    memcpy(o->K[b * RTI_N], o->K[last], sizeof *o->K);
    memcpy(o->inverse[b * RTI_N], o->inverse[last], sizeof *o->inverse);
    memcpy(o->constant[b * RTI_N], o->constant[last], sizeof *o->constant);
  }
}
#endif

/* Entries of the rows at a node of scenario b. */
static inline void rti_row_entries(real (*from)[RTI_LENGTH], int b, int node, real to[RTI_SIZE(RTI_NC)])
{
  for (int i = 0; i < RTI_NC; ++i) {
    const int k = i < RTI_NS ? node - 1 : node;
    to[i] = k >= 0 && k < RTI_N ? from[RTI_NU + i][b * RTI_N + k] : 0;
  }
}

/* The last node of a scenario whose weights differ from those of the factors at hand, which are taken over; -1: none. */
static int rti_changed(rti_work *o, int b)
{
  int last = -1;
  for (int row = 0; row < RTI_ROWS; ++row) {
    const int later = row >= RTI_NU && row - RTI_NU < RTI_NS;
    const real *now = o->weight[row] + b * RTI_N;
    real *factored = o->factored[row] + b * RTI_N;
    for (int k = RTI_N - 1; k >= 0; --k)
      if (now[k] < factored[k] || now[k] > factored[k]) {
        if (k + later > last) last = k + later;
        factored[k] = now[k];
      }
  }
  return last;
}

/* Factorize with the current weights. The recursion goes from the last node to the first: behind the last change of a
 * weight the factors stay. Of the QP without bounds (all weights zero, which is what `is_free` asks for) all are new. */
static void rti_factor(rti_work *o, int is_free)
{
#ifdef RTI_ROBUST
  real sum[RTI_NZ][RTI_W];
#endif
  for (int b = 0; b < RTI_SCENARIOS; ++b) {
    real G[RTI_NZ][RTI_W], w[RTI_SIZE(RTI_NC)];
    const int end = b * (RTI_N + 1) + RTI_N;
    int last = is_free ? RTI_N : rti_changed(o, b);
    if (RTI_SCENARIOS > 1 && last < 0) last = 0;        /* the sum of the scenarios is of the others too */
    if (last == RTI_N) {
      memcpy(G, o->H[end], sizeof G);
      rti_row_entries(o->weight, b, RTI_N, w);
      rti_row_hessian(o->C[end], w, G);
      memcpy(o->P[end], G, sizeof o->P[end]);
    }
    for (int k = rti_lesser(last, RTI_N - 1); k >= 0; --k) {
      const int at = b * RTI_N + k, node = rti_node(at);
      rti_congruence(G, o->H[node], o->P[node + 1], o->M[at]);
      if (!is_free) {
        rti_row_entries(o->weight, b, k, w);
        rti_row_hessian(o->C[node], w, G);
        for (int j = 0; j < RTI_NU; ++j) G[RTI_NX + j][RTI_NX + j] += o->weight[j][at];
      }
#ifdef RTI_ROBUST
      if (k == 0 && !rti_add_scenario(b, G, sum)) break;
#endif
      rti_eliminate(G, o->K[at], o->inverse[at]);
      memcpy(o->P[node], G, sizeof o->P[node]);
    }
  }
}

/* Constant parts of the inputs with the current factors, O(nz^2) per stage instead of O(nz^3): of the QP without bounds, or
 * of the step with the current residual and push. */
static void rti_resolve(rti_work *o, int is_free)
{
#ifdef RTI_ROBUST
  real rest[RTI_NU] = {0};
#endif
  for (int b = 0; b < RTI_SCENARIOS; ++b) {
    const int end = b * (RTI_N + 1) + RTI_N;
    real p[RTI_W] = {0}, w[RTI_SIZE(RTI_NC)];
    if (is_free) memcpy(p, o->g[end], sizeof p);
    else {
      rti_row_entries(o->push, b, RTI_N, w);
      rti_row_gradient(o->C[end], w, p);
    }
    for (int k = RTI_N - 1; k >= 0; --k) {
      const int at = b * RTI_N + k, node = rti_node(at);
      real q[RTI_W] = {0};
      if (is_free) {
        memcpy(q, o->g[node], sizeof q);
        for (int i = 0; i < RTI_NX; ++i)
          for (int l = 0; l < RTI_NX; ++l) p[i] += o->P[node + 1][i < l ? l : i][i < l ? i : l] * o->defect[at][l];
      } else {
        rti_row_entries(o->push, b, k, w);
        rti_row_gradient(o->C[node], w, q);
        for (int j = 0; j < RTI_NU; ++j) q[RTI_NX + j] += o->push[j][at] + o->residual[at][j];
      }
      rti_add_transposed(q, o->M[at], p);
#ifdef RTI_ROBUST
      for (int j = 0; j < RTI_NU && k == 0; ++j) q[RTI_NX + j] = rest[j] += q[RTI_NX + j];
#endif
      rti_eliminate_gradient(q, o->K[at], o->inverse[at], o->constant[at]);
      memcpy(p, q, sizeof p);
    }
  }
#ifdef RTI_ROBUST
  rti_copy_feedback(o);
#endif
}

/* The affine feedback that solves the QP without bounds. */
static void rti_solve_free(rti_work *o)
{
  memset(o->weight, 0, sizeof o->weight);
  memset(o->factored, 0, sizeof o->factored);
  rti_factor(o, 1);
  rti_resolve(o, 1);
  o->is_free = 1;
}

/* Bounded quantities along z; with_constant adds their values at the plan. */
static void rti_bounded(rti_work *o, real (*z)[RTI_W], real (*y)[RTI_LENGTH], int with_constant)
{
  static const real zero[RTI_SIZE(RTI_NC)] = {0};
  for (int b = 0; b < RTI_SCENARIOS; ++b)
    for (int k = 0; k <= RTI_N; ++k) {
      const int node = b * (RTI_N + 1) + k, stage = b * RTI_N + k;
      real value[RTI_SIZE(RTI_NC)];
      if (k < RTI_N)
        for (int j = 0; j < RTI_NU; ++j) y[j][stage] = z[node][RTI_NX + j] + (with_constant ? o->u[stage][j] : 0);
      rti_row_values(with_constant ? o->c[node] : zero, o->C[node], z[node], value);
      for (int i = 0; i < RTI_NC; ++i) {
        const int at = i < RTI_NS ? k - 1 : k;
        if (at >= 0 && at < RTI_N) y[RTI_NU + i][b * RTI_N + at] = value[i];
      }
    }
  for (int i = 0; i < RTI_ROWS; ++i)
    for (int k = RTI_STAGES; k < RTI_LENGTH; ++k) y[i][k] = y[i][RTI_STAGES - 1];
}

/* The trajectory without bounds from the state x0. */
static void rti_free_trajectory(rti_work *o, const real *x0)
{
  for (int b = 0; b < RTI_SCENARIOS; ++b) {
    real (*z)[RTI_W] = o->z + b * (RTI_N + 1);
    memset(z[0], 0, sizeof z[0]);
    for (int i = 0; i < RTI_NX; ++i) z[0][i] = x0[i] - o->x[0][i];
    for (int k = 0; k < RTI_N; ++k) {
      const int at = b * RTI_N + k;
      rti_inputs(z[k], o->K[at], o->constant[at]);
      memset(z[k + 1], 0, sizeof z[k + 1]);
      memcpy(z[k + 1], o->defect[at], sizeof o->defect[at]);
      rti_following(z[k + 1], o->M[at], z[k]);
    }
  }
  rti_bounded(o, o->z, o->y, 1);
}

/* Stiffness of each bounded quantity, multiplier per change, from the inverse Hessian of the QP without bounds: with S
 * that of the state, that of z is [I; K] S [I; K]' + the inverse Hessian of the inputs. It scales the weights and the
 * first multipliers, so that neither depends on units. Zero where no input has an effect beyond rounding (64 eps). */
static void rti_stiffnesses(rti_work *o)
{
  for (int b = 0; b < RTI_SCENARIOS; ++b) {
    real S[RTI_NX][RTI_W] = {{0}};
    for (int k = 0; k <= RTI_N; ++k) {
      const int stage = b * RTI_N + k, node = b * (RTI_N + 1) + k;
      real Z[RTI_NZ][RTI_W] = {{0}};
      memcpy(Z, S, sizeof S);
      for (int j = 0; j < RTI_NU && k < RTI_N; ++j) {
        const int v = RTI_NX + j;
        for (int l = 0; l < v; ++l) rti_add_row(Z[v], o->K[stage][j][l], Z[l], v);
        real own = o->inverse[stage][j];
        for (int l = 0; l < v; ++l) {
          Z[l][v] = Z[v][l];
          own += o->K[stage][j][l] * Z[v][l];
        }
        Z[v][v] = own;
        o->stiffness[j][stage] = own > 0 ? 1 / own : 0;
      }
      for (int i = 0; i < RTI_NC; ++i) {
        const int at = i < RTI_NS ? k - 1 : k;
        if (at < 0 || at >= RTI_N) continue;
        real sum = 0, size = 0;
        for (int l = 0; l < RTI_NZ; ++l) {
          const real c = o->C[node][i][l];
          if (!(c > 0 || c < 0)) continue;        /* most entries are zero */
          real product = 0;
          for (int m = 0; m < RTI_NZ; ++m) product += Z[l][m] * o->C[node][i][m];
          sum += c * product;
          size += c * c * Z[l][l];
        }
        o->stiffness[RTI_NU + i][b * RTI_N + at] = sum > 64 * RTI_EPS * size ? 1 / sum : 0;
      }
      if (k == RTI_N) break;
      memset(S, 0, sizeof S);
#ifdef RTI_VECTOR
      /* whole rows, which registers take at once: M S by those of M' */
      real transposed[RTI_NZ][RTI_W] = {{0}};
      for (int i = 0; i < RTI_NX; ++i)
        for (int m = 0; m < RTI_NZ; ++m) transposed[m][i] = o->M[stage][i][m];
#endif
      for (int i = 0; i < RTI_NX; ++i) {
        real row[RTI_W] = {0};
        for (int m = 0; m < RTI_NZ; ++m) {
          const real a = o->M[stage][i][m];
          /* many are zero, and a row in vector registers costs less than to ask */
          if (RTI_WIDE > 1 || a > 0 || a < 0) rti_add_row(row, a, Z[m], RTI_NZ);
        }
#ifdef RTI_VECTOR
        for (int m = 0; m < RTI_NZ; ++m) rti_add_row(S[i], row[m], transposed[m], RTI_NX);
#else
        rti_following(S[i], o->M[stage], row);
#endif
      }
    }
  }
  for (int i = 0; i < RTI_ROWS; ++i)
    for (int k = RTI_STAGES; k < RTI_LENGTH; ++k) o->stiffness[i][k] = o->stiffness[i][RTI_STAGES - 1];
}

/* Greatest violation of a bounded quantity over the nodes. */
static real rti_excess(const rti_settings *s, int row, const real y[RTI_LENGTH])
{
  real least = y[0], most = y[0];
  for (int k = 1; k < RTI_LENGTH; ++k) {
    least = rti_min(least, y[k]);
    most = rti_max(most, y[k]);
  }
  const real low = rti_low(s, row), high = rti_high(s, row);
  return rti_max(0, rti_max(low > -RTI_ABSENT ? low - least : 0, high < RTI_ABSENT ? most - high : 0));
}

/* The same where other factors are at hand. */
static void rti_stiffnesses_again(rti_work *o)
{
  rti_solve_free(o);
  rti_stiffnesses(o);
  o->has_stiffness = 1;
  o->is_free = 0;
}

/* Upper bounds of the stiffness of inputs, at no cost: with the state before an input given. */
static void rti_pivots(rti_work *o)
{
  for (int k = 0; k < RTI_STAGES; ++k)
    for (int j = 0; j < RTI_NU; ++j) o->stiffness[j][k] = o->inverse[k][j] > 0 ? 1 / o->inverse[k][j] : 0;
}

/* Gradient of the Lagrangian with respect to each input by the adjoint recursion, and the largest sum of the magnitudes
 * of its terms, against which its rounding is judged. */
static void rti_gradient(rti_work *o)
{
  real w[RTI_SIZE(RTI_NC)], *size = o->gradient_size;
  memset(o->gradient_size, 0, sizeof o->gradient_size);
#ifdef RTI_ROBUST
  real total[RTI_NU] = {0}, magnitude[RTI_NU] = {0};    /* of the common inputs, whose gradient is the sum */
#endif
  for (int b = 0; b < RTI_SCENARIOS; ++b) {
    real pi[RTI_NX] = {0};
    for (int k = RTI_N; k >= 0; --k) {
      const int stage = b * RTI_N + k, node = b * (RTI_N + 1) + k;
      real r[RTI_W], carried[RTI_W] = {0};
      memcpy(r, o->g[node], sizeof r);
      rti_add_hessian(r, o->H[node], o->z[node]);
      rti_row_entries(o->force, b, k, w);
      rti_row_gradient(o->C[node], w, r);
      if (k < RTI_N) {
        rti_add_transposed(carried, o->M[stage], pi);
        for (int j = 0; j < RTI_NU; ++j) {
          const real own = r[RTI_NX + j], from = carried[RTI_NX + j], bound = o->force[j][stage];
          o->residual[stage][j] = own + from + bound;
          size[j] = rti_max(size[j], rti_abs(own) + rti_abs(from) + rti_abs(bound));
#ifdef RTI_ROBUST
          if (k > 0) continue;
          total[j] += o->residual[stage][j];
          magnitude[j] += rti_abs(own) + rti_abs(from) + rti_abs(bound);
          size[j] = rti_max(size[j], magnitude[j]);
          o->residual[stage][j] = 0;
#endif
        }
      }
      for (int l = 0; l < RTI_NX; ++l) pi[l] = r[l] + carried[l];
    }
  }
#ifdef RTI_ROBUST
  memcpy(o->residual[0], total, sizeof total);
#endif
}

/* Change of the trajectory and of the bounded quantities; whether it is finite. */
static int rti_advance(rti_work *o)
{
  for (int b = 0; b < RTI_SCENARIOS; ++b) {
    real (*dz)[RTI_W] = o->dz + b * (RTI_N + 1);
    memset(dz[0], 0, sizeof dz[0]);
    for (int k = 0; k < RTI_N; ++k) {
      const int at = b * RTI_N + k;
      rti_inputs(dz[k], o->K[at], o->constant[at]);
      memset(dz[k + 1], 0, sizeof dz[k + 1]);
      rti_following(dz[k + 1], o->M[at], dz[k]);
    }
  }
  rti_bounded(o, o->dz, o->dy, 0);
  return rti_finite(o->dz[0], RTI_NODES * RTI_W);
}

static void rti_move(rti_work *o, real length)
{
  for (int k = 0; k < RTI_NODES; ++k)
    rti_add_row(o->z[k], length, o->dz[k], RTI_NZ);
  rti_bounded(o, o->z, o->y, 1);
}
