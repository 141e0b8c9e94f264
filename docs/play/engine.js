"use strict";
/*
 * The exact engine of drillenv (drillenv/dynamics/flow.py, exact.py and segments.py) in plain JavaScript.
 *
 * State, in SI: y = X1 - X2, v1, v2, and w, the indenter's place behind its moving origin: Xf out of contact and while
 * unloading, Xp while loading, so that the rock force is stiffness * w. Between switches
 *
 *     y'  = v1 - v2
 *     v1' = (F_b - k y - c y') / m1
 *     v2' = (F_a sin(theta) + k y + c y' - kappa w) / m2,    theta' = omega
 *     w'  = v2
 *
 * with kappa = 0 (no contact), k_l (loading) or k_u (unloading). Each regime is solved in closed form: a forced part and
 * two pairs of modes, exp(-decay t)(u C + v S). A regime ends where a known function of time first rises through zero:
 * w in flight, -v2 while loading, v2 or -w while unloading.
 *
 * No switch is missed, by the proof of the Python engine: the quintic through values, slopes and curvatures at both ends
 * of a step is off by at most bound s^3 (h - s)^3 / 720, with a bound on the sixth derivative from the amplitudes of the
 * modes; in Bernstein's basis of degree six, seven numbers not above zero prove that nothing happens on the step. A step
 * that cannot be proved is halved.
 *
 * The two engines differ in rounding only: sines come from Math.sin, and no multiply-add is fused.
 */
const Engine = (() => {
  const TURN = 2 * Math.PI;
  const FREE = 0, LOADING = 1, UNLOADING = 2;

  // where things stand in a state
  const Y = 0, V1 = 1, V2 = 2, W = 3, ORIGIN = 4, CARRY = 5, THETA = 6, SINE = 7, COSINE = 8, TURNS = 9, REGIME = 10;
  const STATE_SIZE = 11;

  // where things stand in the first row of a model, (3, ROW): the rig and the flight
  const ROW = 68;
  const M1 = 0, M2 = 1, K = 2, C = 3, OMEGA = 4, AMPLITUDE = 5, STATIC = 6, SHARE = 7, SWING = 8, RELATIVE = 9, FREE_Y = 12;
  // and in the row of a contact regime
  const STIFFNESS = 0, STEP = 1, FAST = 2, SLOW = 5, FORCED = 8, FAST_COSINE = 20, FAST_SINE = 36, SLOW_SINE = 52;

  const FREE_STEP = 2.2; // first step of the search in flight, over the quickest of its rates
  const GOES_ON = 0, AT_SURFACE = 1, AT_REST = 2; // how a regime ends: not yet, at w = 0, or at v2 = 0

  // working memory, so that the loops allocate nothing
  const work = new Float64Array(16);
  const channel = new Float64Array(17);
  const pair = new Float64Array(2);
  const found = new Float64Array(4); // value, slope and curvature of a switch function, and w
  const bounds = new Float64Array(3);

  // --- Small complex and matrix arithmetic

  const times = (a, b) => [a[0] * b[0] - a[1] * b[1], a[0] * b[1] + a[1] * b[0]];

  function over(a, b) {
    const size = b[0] * b[0] + b[1] * b[1];
    return [(a[0] * b[0] + a[1] * b[1]) / size, (a[1] * b[0] - a[0] * b[1]) / size];
  }

  const product = (a, b) => a.map((row) => row.map((_, j) => row.reduce((sum, x, m) => sum + x * b[m][j], 0)));
  const combined = (p, a, q, b) => a.map((row, i) => row.map((x, j) => p * x + q * b[i][j]));
  const unit = () => [0, 1, 2, 3].map((i) => [0, 1, 2, 3].map((j) => (i === j ? 1 : 0)));

  // --- The model: a rig on a rock at a setting

  /* Decay, split and root of the roots of s^2 + linear s + constant. */
  function setPair(model, at, linear, constant) {
    const split = 0.25 * linear * linear - constant;
    model[at] = 0.5 * linear;
    model[at + 1] = split;
    model[at + 2] = Math.sqrt(Math.abs(split));
  }

  /* The larger of the absolute values of the two roots of the pair at `at`, in 1/s. */
  function quickest(model, at) {
    const decay = model[at], split = model[at + 1];
    return split > 0 ? decay + model[at + 2] : Math.sqrt(decay * decay - split);
  }

  /* Bairstow's iteration for the slow factor s^2 + a s + e of the characteristic polynomial of a contact. */
  function slowFactor(b3, b2, b1, b0, a, e) {
    for (let i = 0; i < 200; i++) {
      const q1 = b3 - a, q0 = b2 - e - a * q1;
      const r1 = b1 - e * q1 - a * q0, r0 = b0 - e * q0;
      const r1a = e - q0 + a * (q1 - a), r1e = a - q1, r0a = e * (q1 - a), r0e = e - q0;
      const determinant = r1a * r0e - r1e * r0a;
      const da = (r1e * r0 - r0e * r1) / determinant, de = (r0a * r1 - r1a * r0) / determinant;
      a += da;
      e += de;
      if (Math.abs(da) <= 1e-15 * Math.abs(a) && Math.abs(de) <= 1e-15 * Math.abs(e)) break;
    }
    return [a, e];
  }

  /* Write the modes of a contact of stiffness `kappa` into a row of the model. */
  function setContact(model, regime, kappa) {
    const m1 = model[M1], m2 = model[M2], k = model[K], c = model[C], at = ROW * regime;
    const b3 = c / m1 + c / m2, b2 = (k + kappa) / m2 + k / m1;
    const b1 = (c * kappa) / (m1 * m2), b0 = (k * kappa) / (m1 * m2);
    const [a, e] = slowFactor(b3, b2, b1, b0, c / m1, k / m1);
    const q1 = b3 - a, q0 = b2 - e - a * q1;
    const flow = [[0, 1, -1, 0], [-k / m1, -c / m1, c / m1, 0], [k / m2, c / m2, -c / m2, -kappa / m2], [0, 0, 1, 0]];
    // projector on the fast pair: (alpha A + beta) (A^2 + a A + e), purified once of its rounding
    const d = a - q1, g = e - q0, resultant = d * d * q0 - d * g * q1 + g * g, one = unit();
    let projector = product(
      combined(-d / resultant, flow, (g - d * q1) / resultant, one),
      combined(1, combined(1, product(flow, flow), a, flow), e, one),
    );
    const square = product(projector, projector);
    projector = combined(3, square, -2, product(square, projector));
    setPair(model, at + FAST, q1, q0);
    setPair(model, at + SLOW, a, e);
    const fast = product(combined(1, flow, 0.5 * q1, one), projector);
    const slow = product(combined(1, flow, 0.5 * a, one), combined(1, one, -1, projector));
    for (let i = 0; i < 4; i++) {
      for (let j = 0; j < 4; j++) {
        model[at + FAST_COSINE + 4 * j + i] = projector[i][j];
        model[at + FAST_SINE + 4 * j + i] = fast[i][j];
        model[at + SLOW_SINE + 4 * j + i] = slow[i][j];
      }
    }
    model[at + STIFFNESS] = kappa;
    model[at + STEP] = 2.6 / quickest(model, at + FAST);
  }

  /* Write the setting: omega in rad/s, F_a and F_b in N. */
  function setDrive(model, omega, amplitude, fixed) {
    const m1 = model[M1], m2 = model[M2], k = model[K], c = model[C], mass = (m1 * m2) / (m1 + m2);
    model[OMEGA] = omega;
    model[AMPLITUDE] = amplitude;
    model[STATIC] = fixed;
    model[SWING] = amplitude / ((m1 + m2) * omega);
    const swing = over([-amplitude / m2, 0], [k / mass - omega * omega, (omega * c) / mass]);
    model[FREE_Y] = (fixed * mass) / (m1 * k);
    model[FREE_Y + 1] = swing[0];
    model[FREE_Y + 2] = swing[1];
    for (const regime of [LOADING, UNLOADING]) {
      const kappa = model[ROW * regime + STIFFNESS], at = ROW * regime + FORCED;
      const coupling = [k, c * omega];
      const shaker = [k - m1 * omega * omega, c * omega];
      const indenter = [k + kappa - m2 * omega * omega, c * omega];
      const a = times(shaker, indenter), b = times(coupling, coupling);
      const w = over([amplitude * shaker[0], amplitude * shaker[1]], [a[0] - b[0], a[1] - b[1]]);
      const x = over(times(w, coupling), shaker);
      // the motion is the imaginary part of amplitude * exp(i theta); constant, sine and cosine part of y, v1, v2, w
      model.set([fixed / k, 0, 0, fixed / kappa], at);
      model.set([x[0] - w[0], -omega * x[1], -omega * w[1], w[0]], at + 4);
      model.set([x[1] - w[1], omega * x[0], omega * w[0], w[1]], at + 8);
    }
  }

  /*
   * The model of `rig` {m1, m2, k, c, driveSlope, driveBase, push} on `rock` {kl, ku} at `setting`
   * {frequency in Hz, amplitude in V, pressure in bar}: Eq. 3.5 and 3.6 give the forces.
   */
  function makeModel(rig, rock, setting) {
    const model = new Float64Array(3 * ROW);
    model.set([rig.m1, rig.m2, rig.k, rig.c]);
    const mass = (rig.m1 * rig.m2) / (rig.m1 + rig.m2);
    model[SHARE] = rig.m1 / (rig.m1 + rig.m2);
    setPair(model, RELATIVE, rig.c / mass, rig.k / mass);
    setContact(model, LOADING, rock.kl);
    setContact(model, UNLOADING, rock.ku);
    const force = (rig.driveSlope * setting.frequency + rig.driveBase) * setting.amplitude;
    setDrive(model, TURN * setting.frequency, force, rig.push * setting.pressure);
    return model;
  }

  // --- The flow of each regime

  /* exp(-decay t) C(t) and exp(-decay t) S(t) of the pair at `at`, with C'' = split C, S(0) = 0, S'(0) = 1. */
  function pairAt(model, at, t) {
    const decay = model[at], root = model[at + 2], x = model[at + 1] * t * t;
    if (Math.abs(x) < 0.05) {
      const envelope = Math.exp(-decay * t);
      pair[0] = envelope * (1 + x * (1 / 2 + x * (1 / 24 + x * (1 / 720 + x * (1 / 40320 + x / 3628800)))));
      pair[1] = envelope * t * (1 + x * (1 / 6 + x * (1 / 120 + x * (1 / 5040 + x * (1 / 362880 + x / 39916800)))));
    } else if (x < 0) {
      const envelope = Math.exp(-decay * t);
      pair[0] = envelope * Math.cos(root * t);
      pair[1] = (envelope * Math.sin(root * t)) / root;
    } else {
      // exponents first: cosh alone would overflow on a long flight
      const up = 0.5 * Math.exp((root - decay) * t), down = 0.5 * Math.exp(-(root + decay) * t);
      pair[0] = up + down;
      pair[1] = (up - down) / root;
    }
  }

  /* Write u, v of the fast pair and u, v of the slow pair, for a contact that starts in `z`, into `work`. */
  function contactCoefficients(model, regime, z, sine, cosine) {
    const at = ROW * regime;
    for (let i = 0; i < 4; i++) {
      work[8 + i] = z[i] - model[at + FORCED + i] - sine * model[at + FORCED + 4 + i] - cosine * model[at + FORCED + 8 + i];
    }
    const h0 = work[8], h1 = work[9], h2 = work[10], h3 = work[11];
    for (let i = 0; i < 4; i++) {
      const p = at + FAST_COSINE + i, q = at + FAST_SINE + i, r = at + SLOW_SINE + i;
      work[i] = model[p] * h0 + model[p + 4] * h1 + model[p + 8] * h2 + model[p + 12] * h3;
      work[4 + i] = model[q] * h0 + model[q + 4] * h1 + model[q + 8] * h2 + model[q + 12] * h3;
      work[12 + i] = model[r] * h0 + model[r + 4] * h1 + model[r + 8] * h2 + model[r + 12] * h3;
      work[8 + i] -= work[i];
    }
  }

  /* The state a time `t` after the contact in `work` began; `sine` and `cosine` of the phase reached. */
  function contactState(model, regime, sine, cosine, t, z) {
    const at = ROW * regime;
    pairAt(model, at + FAST, t);
    const fc = pair[0], fs = pair[1];
    pairAt(model, at + SLOW, t);
    const sc = pair[0], ss = pair[1];
    for (let i = 0; i < 4; i++) {
      const forced = model[at + FORCED + i] + sine * model[at + FORCED + 4 + i] + cosine * model[at + FORCED + 8 + i];
      z[i] = forced + fc * work[i] + fs * work[4 + i] + sc * work[8 + i] + ss * work[12 + i];
    }
  }

  /* Write the flight that starts in `z` into `work`: [0..2] the centre of mass, [3], [4] u and v of y. */
  function freeCoefficients(model, z, sine, cosine) {
    const share = model[SHARE], swing = model[SWING], omega = model[OMEGA];
    work[0] = z[W] + share * z[Y] + (swing / omega) * sine;
    work[1] = share * z[V1] + (1 - share) * z[V2] + swing * cosine;
    work[2] = model[STATIC] / (model[M1] + model[M2]);
    const u = z[Y] - model[FREE_Y] - sine * model[FREE_Y + 1] - cosine * model[FREE_Y + 2];
    const speed = z[V1] - z[V2] - omega * (cosine * model[FREE_Y + 1] - sine * model[FREE_Y + 2]);
    work[3] = u;
    work[4] = speed + model[RELATIVE] * u;
  }

  function freeState(model, sine, cosine, t, z) {
    const share = model[SHARE], swing = model[SWING], omega = model[OMEGA];
    const decay = model[RELATIVE], split = model[RELATIVE + 1], u = work[3], v = work[4];
    pairAt(model, RELATIVE, t);
    const c = pair[0], s = pair[1];
    const y = model[FREE_Y] + sine * model[FREE_Y + 1] + cosine * model[FREE_Y + 2] + c * u + s * v;
    const speed = omega * (cosine * model[FREE_Y + 1] - sine * model[FREE_Y + 2])
      + c * (v - decay * u) + s * (split * u - decay * v);
    const centre = work[0] + t * (work[1] + 0.5 * t * work[2]) - (swing / omega) * sine;
    const centreSpeed = work[1] + t * work[2] - swing * cosine;
    z[Y] = y;
    z[V1] = centreSpeed + (1 - share) * speed;
    z[V2] = centreSpeed - share * speed;
    z[W] = centre - share * y;
  }

  // --- The state, and the regime that it calls for

  function setPhase(state, theta) {
    state[THETA] = theta;
    state[SINE] = Math.sin(theta);
    state[COSINE] = Math.cos(theta);
  }

  /* The rig at rest: the cylinder leans on the spring, the indenter just touches rock never hit before. */
  function freshState(model, theta = 0) {
    const state = new Float64Array(STATE_SIZE);
    state[Y] = model[STATIC] / model[K];
    setPhase(state, theta);
    return state;
  }

  function acceleration(model, z, sine, kappa) {
    return (model[AMPLITUDE] * sine + model[K] * z[Y] + model[C] * (z[V1] - z[V2]) - kappa * z[W]) / model[M2];
  }

  /* Move the origin; the rounding is carried along (Kahan), so that long drift costs no digits. */
  function shiftOrigin(state, shift) {
    const owed = shift + state[CARRY], moved = state[ORIGIN] + owed;
    state[CARRY] = owed - (moved - state[ORIGIN]);
    state[ORIGIN] = moved;
  }

  /* Set the regime by the sign of v2, where that is zero of the acceleration, and then of its derivative. */
  function settle(model, state) {
    const w = state[W], regime = state[REGIME];
    if (w < 0) return (state[REGIME] = FREE);
    const kappa = model[ROW * (regime === LOADING ? LOADING : UNLOADING) + STIFFNESS];
    let heading = state[V2];
    if (heading === 0) heading = acceleration(model, state, state[SINE], kappa);
    if (heading === 0) {
      const speed = state[V1] - state[V2];
      const shaker = (model[STATIC] - model[K] * state[Y] - model[C] * speed) / model[M1];
      heading = model[AMPLITUDE] * model[OMEGA] * state[COSINE] + model[K] * speed + model[C] * shaker;
    }
    if (w === 0) return (state[REGIME] = heading > 0 ? LOADING : FREE);
    const wanted = heading > 0 ? LOADING : UNLOADING;
    if (regime !== wanted) {
      // the same force at the same place, measured from Xf instead of Xp or the other way round
      const scaled = (w * kappa) / model[ROW * wanted + STIFFNESS];
      shiftOrigin(state, w - scaled);
      state[W] = scaled;
    }
    return (state[REGIME] = wanted);
  }

  // --- The search for the end of a regime

  /* Write u, v of exp(-decay t)(u C + v S) and of its first two time derivatives into the channel. */
  function openPair(model, pairAtIndex, u, v, at) {
    const decay = model[pairAtIndex], split = model[pairAtIndex + 1];
    for (let i = at; i < at + 6; i += 2) {
      channel[i] = u;
      channel[i + 1] = v;
      const next = v - decay * u;
      v = split * u - decay * v;
      u = next;
    }
  }

  /* Take the coming regime apart into modes; write what the switch functions need into `channel`. */
  function openChannel(model, regime, state) {
    const sine = state[SINE], cosine = state[COSINE];
    if (regime === FREE) {
      freeCoefficients(model, state, sine, cosine);
      const share = model[SHARE];
      channel[0] = work[0] - share * model[FREE_Y];
      channel[1] = work[1];
      channel[2] = work[2];
      channel[3] = -model[SWING] / model[OMEGA] - share * model[FREE_Y + 1];
      channel[4] = -share * model[FREE_Y + 2];
      openPair(model, RELATIVE, -share * work[3], -share * work[4], 5);
      return;
    }
    const at = ROW * regime;
    contactCoefficients(model, regime, state, sine, cosine);
    channel[0] = model[at + FORCED + 6];
    channel[1] = model[at + FORCED + 10];
    openPair(model, at + FAST, work[2], work[6], 5);
    openPair(model, at + SLOW, work[10], work[14], 11);
  }

  /* The switch function, its first two derivatives, and w, into `found`. `release`: unloading asked for w. */
  function probe(model, regime, release, theta, t) {
    const omega = model[OMEGA], sine = Math.sin(theta + omega * t), cosine = Math.cos(theta + omega * t);
    if (regime === FREE) {
      pairAt(model, RELATIVE, t);
      const c = pair[0], s = pair[1], wave = channel[3] * sine + channel[4] * cosine;
      const w = t * (0.5 * t * channel[2] + channel[1]) + channel[0] + (c * channel[5] + (s * channel[6] + wave));
      found[0] = found[3] = w;
      found[1] = t * channel[2] + channel[1]
        + (c * channel[7] + (s * channel[8] + omega * (channel[3] * cosine - channel[4] * sine)));
      found[2] = channel[2] - omega * omega * wave + (c * channel[9] + s * channel[10]);
      return;
    }
    const at = ROW * regime;
    pairAt(model, at + FAST, t);
    const fc = pair[0], fs = pair[1];
    pairAt(model, at + SLOW, t);
    const sc = pair[0], ss = pair[1];
    const w = model[at + FORCED + 3] + sine * model[at + FORCED + 7] + cosine * model[at + FORCED + 11]
      + (fc * work[3] + fs * work[7]) + (sc * work[11] + ss * work[15]);
    const wave = channel[0] * sine + channel[1] * cosine;
    const v = wave + (fc * channel[5] + fs * channel[6]) + (sc * channel[11] + ss * channel[12]);
    const a = omega * (channel[0] * cosine - channel[1] * sine)
      + (fc * channel[7] + fs * channel[8]) + (sc * channel[13] + ss * channel[14]);
    const j = fc * channel[9] + fs * channel[10] + (sc * channel[15] + (ss * channel[16] - omega * omega * wave));
    const sign = regime === LOADING ? -1 : 1;
    found[0] = release ? -w : sign * v;
    found[1] = release ? -v : sign * a;
    found[2] = release ? -a : sign * j;
    found[3] = w;
  }

  /* Bound on the sixth derivative of exp(-decay t)(u C + v S) at t = 0. */
  function pairBound(model, at, u, v) {
    const decay = model[at], root = model[at + 2], rate = quickest(model, at);
    const reach = 6 / rate + Math.min(root > 0 ? 1 / root : Infinity, decay > 0 ? 1 / decay : Infinity);
    return rate ** 6 * (Math.abs(u) + Math.abs(v) * reach);
  }

  /* Into `bounds`: the sixth derivative of the switch function is at most lasting + fading exp(-rate t). */
  function sixthDerivativeBounds(model, regime) {
    const quick = model[OMEGA] ** 6, at = regime === FREE ? RELATIVE : ROW * regime + FAST;
    bounds[1] = pairBound(model, at, channel[5], channel[6]);
    bounds[2] = model[at + 1] > 0 ? model[at] - model[at + 2] : model[at];
    bounds[0] = regime === FREE
      ? quick * (Math.abs(channel[3]) + Math.abs(channel[4]))
      : quick * (Math.abs(channel[0]) + Math.abs(channel[1]))
        + pairBound(model, ROW * regime + SLOW, channel[11], channel[12]);
  }

  /* Whether a function with values f, slopes d and curvatures c at 0 and h surely stays below zero in between. */
  function staysBelow(f0, d0, c0, f1, d1, c1, h, bound) {
    const first = f0 + (h * d0) / 5, last = f1 - (h * d1) / 5;
    const second = f0 + h * (0.4 * d0 + 0.05 * h * c0), fourth = f1 + h * (0.05 * h * c1 - 0.4 * d1);
    const middle = 0.5 * (second + fourth) + (bound * h ** 6) / 14400;
    return f0 <= 0 && f1 <= 0 && middle < 0 && f0 + 5 * first <= 0 && first + 2 * second <= 0
      && last + 2 * fourth <= 0 && f1 + 5 * last <= 0;
  }

  /* Where the quintic through the values at 0 and h rises through zero, for f0 <= 0 <= f1; a first guess. */
  function quinticRoot(f0, d0, c0, f1, d1, c1, h) {
    const rise = f1 - f0, b1 = h * d1, b2 = 0.5 * h * h * c1;
    let a0 = f0, a1 = h * d0, a2 = 0.5 * h * h * c0;
    let a3 = 10 * rise - 6 * a1 - 4 * b1 - 3 * a2 + b2;
    let a4 = -15 * rise + 8 * a1 + 7 * b1 + 3 * a2 - 2 * b2;
    let a5 = 6 * rise - 3 * (a1 + b1) - a2 + b2;
    // a root at the start is not the one looked for
    if (f0 === 0) [a0, a1, a2, a3, a4, a5] = [a1, a2, a3, a4, a5, 0];
    const top = a0 + a1 + a2 + a3 + a4 + a5;
    let s = a0 < 0 && top > 0 ? -a0 / (top - a0) : 0.5;
    for (let i = 0; i < 2; i++) {
      const value = a0 + s * (a1 + s * (a2 + s * (a3 + s * (a4 + s * a5))));
      const slope = a1 + s * (2 * a2 + s * (3 * a3 + s * (4 * a4 + s * 5 * a5)));
      const bend = a2 + s * (3 * a3 + s * (6 * a4 + s * 10 * a5));
      s -= (value * slope) / (slope * slope - value * bend);
      if (!(s > 0 && s <= 1)) return 0.5 * h;
    }
    return h * s;
  }

  /*
   * Where the switch function rises through zero in (low, high], to about 1e-10 of the time, by safeguarded
   * Newton-Halley. Returns the time; slope, curvature and w there are in `found`.
   */
  function firstRoot(model, regime, release, theta, low, high, guess, rate) {
    let t = guess;
    for (let i = 0; i < 200; i++) {
      probe(model, regime, release, theta, t);
      const f = found[0], d = found[1], c = found[2];
      if (f < 0) low = t;
      else high = t;
      let following = 0.5 * (low + high);
      if (d > 0) {
        let step = -f / d;
        let bend = 1 - (0.5 * f * c) / (d * d);
        if (bend > 0.5) step /= bend;
        if (low <= t + step && t + step <= high) {
          following = t + step;
          // Halley's step leaves an error of its own cube; what is this small putOnSwitch takes away
          bend = (rate + Math.abs(c / d)) * step;
          if (Math.abs(step) * bend * bend <= 1e-10 * t) {
            found[1] = d + c * step;
            return following;
          }
        }
      }
      if (following === t || high - low <= 4e-16 * high) return following;
      t = following;
    }
    return t;
  }

  /* A maximum of the switch function in [low, high], where it rises at one end and falls at the other. */
  function highestPoint(model, regime, theta, low, high) {
    let t = 0.5 * (low + high);
    for (let i = 0; i < 60; i++) {
      probe(model, regime, false, theta, t);
      const d = found[1], c = found[2];
      if (d > 0) low = t;
      else high = t;
      let following = c < 0 ? t - d / c : 0.5 * (low + high);
      if (!(low < following && following < high)) following = 0.5 * (low + high);
      if (Math.abs(following - t) <= 1e-12 * t || high - low <= 4e-16 * high) break;
      t = following;
    }
    return t;
  }

  /* Second derivative of the switch function where the regime begins. */
  function curvatureAtStart(model, regime, state) {
    const square = model[OMEGA] ** 2, sine = state[SINE], cosine = state[COSINE];
    if (regime === FREE) return channel[2] - square * (channel[3] * sine + channel[4] * cosine) + channel[9];
    const jerk = channel[9] + channel[15] - square * (channel[0] * sine + channel[1] * cosine);
    return regime === LOADING ? -jerk : jerk;
  }

  let ending = GOES_ON; // how the regime that findSwitch looked at ends

  /* Time to the end of this regime, at most `limit`; sets `ending`. */
  function findSwitch(model, regime, state, limit) {
    const theta = state[THETA];
    let usual, f0, d0;
    if (regime === FREE) {
      usual = FREE_STEP / Math.max(model[OMEGA], quickest(model, RELATIVE));
      f0 = state[W];
      d0 = state[V2];
    } else {
      const kappa = model[ROW * regime + STIFFNESS], sign = regime === LOADING ? -1 : 1;
      usual = model[ROW * regime + STEP];
      f0 = sign * state[V2];
      d0 = sign * acceleration(model, state, state[SINE], kappa);
    }
    let c0 = curvatureAtStart(model, regime, state);
    sixthDerivativeBounds(model, regime);
    const lasting = bounds[0], fading = bounds[1], rate = bounds[2];
    let bound = lasting + fading, t0 = 0, w0 = state[W], step = usual;
    for (;;) {
      let t1 = Math.min(t0 + step, limit), h = t1 - t0;
      // where steps this short prove nothing, the function touches zero, or as good as
      const grazing = h < 1e-3 * usual;
      probe(model, regime, false, theta, t1);
      if (grazing && d0 > 0 && found[1] < 0 && found[0] < 0) {
        t1 = highestPoint(model, regime, theta, t0, t1);
        h = t1 - t0;
        probe(model, regime, false, theta, t1);
      }
      const f1 = found[0], d1 = found[1], c1 = found[2], w1 = found[3];
      if (regime === UNLOADING && w1 <= 0) {
        // w falls through zero in between; it is the end unless v2 rises through zero before
        const guess = t0 + quinticRoot(-w0, -f0, -d0, -w1, -f1, -d1, h);
        const tau = firstRoot(model, regime, true, theta, t0, t1, guess, 1 / usual);
        let sure = grazing || staysBelow(f0, d0, c0, f1, d1, c1, h, bound);
        if (!sure) {
          // v2 may have turned after the release: prove it up to there
          probe(model, regime, false, theta, tau);
          sure = staysBelow(f0, d0, c0, found[0], found[1], found[2], tau - t0, bound);
        }
        if (sure) {
          ending = AT_SURFACE;
          return tau;
        }
      } else if (f1 >= 0) {
        const guess = t0 + quinticRoot(f0, d0, c0, f1, d1, c1, h);
        const tau = firstRoot(model, regime, false, theta, t0, t1, guess, 1 / usual);
        if (grazing || staysBelow(f0, d0, c0, 0, found[1], found[2], tau - t0, bound)) {
          if (regime === UNLOADING && found[3] <= 0) {
            // w dipped below zero and came back within the step
            ending = AT_SURFACE;
            return firstRoot(model, regime, true, theta, t0, tau, t0 + 0.5 * (tau - t0), 1 / usual);
          }
          ending = regime === FREE ? AT_SURFACE : AT_REST;
          return tau;
        }
      } else if (grazing || staysBelow(f0, d0, c0, f1, d1, c1, h, bound)) {
        if (t1 >= limit) {
          ending = GOES_ON;
          return limit;
        }
        t0 = t1;
        f0 = f1;
        d0 = d1;
        c0 = c1;
        w0 = w1;
        bound = lasting + fading * Math.exp(-rate * t0);
        // as far as the quintic can be trusted (its error grows with the sixth power), and at most half a period
        const reach = (4000 * Math.abs(f0)) / (bound * usual ** 6);
        const stretch = reach > 4096 ? 4 : reach > 729 ? 3 : reach > 64 ? 2 : reach > 11.4 ? 1.5 : 1;
        step = Math.min(stretch * usual, 3 / model[OMEGA]);
        continue;
      }
      step = 0.5 * h;
    }
  }

  /* Move a state within rounding of its switch onto it, to first order. Returns the time that takes. */
  function putOnSwitch(model, state, regime, sine) {
    const kappa = regime === FREE ? 0 : model[ROW * regime + STIFFNESS];
    const speed = state[V1] - state[V2], structure = model[K] * state[Y] + model[C] * speed;
    const indenter = acceleration(model, state, sine, kappa);
    let shift = ending === AT_SURFACE ? -state[W] / state[V2] : -state[V2] / indenter;
    // a grazing switch has no slope to go by, and Newton has met it to the last digit already
    if (!(Math.abs(shift) <= 1e-9)) shift = 0;
    state[Y] += shift * speed;
    state[V1] += (shift * (model[STATIC] - structure)) / model[M1];
    if (ending === AT_SURFACE) {
      state[V2] += shift * indenter;
      state[W] = 0;
    } else {
      state[V2] = 0;
    }
    return shift;
  }

  /* Go through the regime just begun, to its switch but at most `limit` s on. Returns the time taken. */
  function complete(model, state, regime, limit) {
    const omega = model[OMEGA];
    let tau = findSwitch(model, regime, state, limit);
    let theta = state[THETA] + omega * tau, sine = Math.sin(theta), cosine = Math.cos(theta);
    if (regime === FREE) freeState(model, sine, cosine, tau, state);
    else contactState(model, regime, sine, cosine, tau, state);
    if (ending === GOES_ON) {
      // rounding must not leave a contact that has not begun
      if (regime === FREE) state[W] = Math.min(state[W], 0);
    } else {
      const shift = putOnSwitch(model, state, regime, sine), turned = omega * shift;
      tau += shift;
      theta += turned;
      [sine, cosine] = [sine + turned * cosine, cosine - turned * sine];
    }
    while (theta >= TURN) {
      theta -= TURN;
      state[TURNS] += 1;
    }
    state[THETA] = theta;
    state[SINE] = sine;
    state[COSINE] = cosine;
    return tau;
  }

  /*
   * Move the state `duration` s on. `enter(before, regime, state)` is called where each segment begins, and
   * `left(regime, tau)` with its length where it ends; either may be left out.
   */
  function advance(model, state, duration, enter, left) {
    // the rounding that the time left owes is carried along (Kahan): thousands of switches must not move the end
    let remaining = duration, owed = 0;
    while (remaining > 0) {
      const before = state[REGIME], regime = settle(model, state);
      if (enter) enter(before, regime, state);
      openChannel(model, regime, state);
      const tau = complete(model, state, regime, remaining);
      if (left) left(regime, tau);
      if (tau === remaining) break;
      const step = -tau - owed, next = remaining + step;
      owed = next - remaining - step;
      remaining = next;
    }
  }

  /* Move the state one excitation period on, back to exactly the phase where it stands. */
  function advancePeriod(model, state, enter, left) {
    const theta = state[THETA], turns = state[TURNS];
    advance(model, state, TURN / model[OMEGA], enter, left);
    setPhase(state, theta);
    state[TURNS] = turns + 1;
  }

  /* Xf in m: how far the rock's face has moved. */
  function face(model, z, regime, origin) {
    if (regime !== LOADING) return origin;
    return origin + z[W] * (1 - model[ROW * LOADING + STIFFNESS] / model[ROW * UNLOADING + STIFFNESS]);
  }

  // --- What is read off a motion

  const LONGEST_PERIOD = 32; // the longest period looked for, in excitation periods
  const CLOSED = 1e-9; // a motion has settled where it comes back to this share of the indenter's own amplitude
  const SAME = 1e-6; // crossings this close are not told apart as those of a longer motion

  /*
   * A run that goes on and on: the state at phase 0 with the last crossings, by which its period is told.
   * `periods` counts those run since the last change of setting.
   */
  class Orbit {
    constructor(model) {
      this.state = freshState(model);
      this.track = new Float64Array(4 * (2 * LONGEST_PERIOD + 1));
      this.change(model);
    }

    /* Go on from where the rig stands, at another setting or on another rock. */
    change(model) {
      this.model = model;
      this.periods = 0;
      this.period = 0;
      this.state[ORIGIN] = this.state[CARRY] = this.state[TURNS] = 0;
      setPhase(this.state, 0);
    }

    /* Run up to `most` periods, until the motion repeats. Returns its period, 0 where it does not (yet). */
    run(most) {
      for (let n = 0; n < most && !this.period; n++) {
        advancePeriod(this.model, this.state);
        this.periods += 1;
        this.remember();
        if (this.periods % 16 === 0) {
          const period = this.closes();
          if (period && !this.halves(period)) this.period = period;
        }
      }
      return this.period;
    }

    /* Note the crossing, with w measured from Xf in every regime: orbits are smooth in it. */
    remember() {
      const { model, state, track } = this;
      const scale = model[AMPLITUDE] / (model[M2] * model[OMEGA] ** 2);
      const share = state[REGIME] === LOADING && state[W] > 0
        ? model[ROW * LOADING + STIFFNESS] / model[ROW * UNLOADING + STIFFNESS] : 1;
      track.copyWithin(4, 0);
      track[0] = state[Y] / scale;
      track[1] = state[V1] / (scale * model[OMEGA]);
      track[2] = state[V2] / (scale * model[OMEGA]);
      track[3] = (share * state[W]) / scale;
    }

    /*
     * The smallest n such that each of the last 33 crossings is within `tolerance` of the one n periods before, 0 where
     * there is none.
     */
    closes(tolerance = CLOSED) {
      if (this.periods < 2 * LONGEST_PERIOD + 1) return 0;
      for (let n = 1; n <= LONGEST_PERIOD; n++) {
        let apart = 0;
        for (let i = 0; i <= LONGEST_PERIOD && apart <= tolerance; i++) apart = Math.max(apart, this.apart(i, i + n));
        if (apart <= tolerance) return n;
      }
      return 0;
    }

    /*
     * Whether a motion that closes after `n` periods may still be closing in, from both sides, on one of a divisor of n,
     * as it does near a period doubling: crossings so many periods apart are the same, or draw nearer.
     */
    halves(n) {
      const earlier = LONGEST_PERIOD - (LONGEST_PERIOD % n);
      for (let d = 1; d < n; d++) {
        if (n % d) continue;
        const now = this.apart(0, d);
        if (now < SAME || Math.abs(now - this.apart(earlier, earlier + d)) > CLOSED) return true;
      }
      return false;
    }

    /* The largest difference of two crossings, i and j periods ago. */
    apart(i, j) {
      let most = 0;
      for (let m = 0; m < 4; m++) most = Math.max(most, Math.abs(this.track[4 * i + m] - this.track[4 * j + m]));
      return most;
    }

    /* The largest Lyapunov exponent in 1/s, from a second run close by that is pulled back after each period. */
    exponent(periods) {
      const { model, state } = this, scale = model[AMPLITUDE] / (model[M2] * model[OMEGA] ** 2), near = 1e-6;
      const units = [scale, scale * model[OMEGA], scale * model[OMEGA], scale];
      const twin = Float64Array.from(state);
      for (let i = 0; i < 4; i++) twin[i] += 0.5 * near * units[i];
      let total = 0;
      for (let n = 0; n < periods; n++) {
        if (n > 0) {
          advancePeriod(model, state);
          advancePeriod(model, twin);
          // w as the first counts it
          if (twin[W] > 0 && twin[REGIME] !== state[REGIME] && twin[REGIME] !== FREE && state[REGIME] !== FREE) {
            twin[W] *= model[ROW * twin[REGIME] + STIFFNESS] / model[ROW * state[REGIME] + STIFFNESS];
          }
        }
        const apart = Math.hypot(...units.map((each, i) => (twin[i] - state[i]) / each));
        if (n > 0) total += Math.log(apart / near);
        for (let i = 0; i < 4; i++) twin[i] = state[i] + (near / apart) * (twin[i] - state[i]);
        twin[REGIME] = state[REGIME];
      }
      return (total * model[OMEGA]) / (TURN * (periods - 1));
    }
  }

  /*
   * Follow a copy of `state` over `periods` excitation periods. Returns {impacts, contacts, rate in m/s, peakForce in N,
   * impactTimes in s} and, `perPeriod` > 0, samples {time in s, force in N, acceleration in m/s^2, place (X2 - Xf) in m,
   * speed in m/s, regime} at that many even times a period and at every switch.
   */
  function follow(model, state, periods, perPeriod = 0) {
    const z = new Float64Array(4), now = Float64Array.from(state);
    const samples = { time: [], force: [], acceleration: [], place: [], speed: [], regime: [] };
    const kl = model[ROW * LOADING + STIFFNESS], ku = model[ROW * UNLOADING + STIFFNESS];
    const spacing = perPeriod ? TURN / model[OMEGA] / perPeriod : Infinity;
    const result = { impacts: 0, contacts: 0, peakForce: 0, peakSpeed: 0, rate: 0, impactTimes: [], contactTimes: [], samples };
    const from = face(model, now, now[REGIME], now[ORIGIN]);
    let begun = 0, next = 0, theta = 0;

    function note(t, regime, sine) {
      const kappa = regime === FREE ? 0 : regime === LOADING ? kl : ku;
      samples.time.push(t);
      samples.force.push(kappa * Math.max(z[W], 0));
      samples.acceleration.push(acceleration(model, z, sine, kappa));
      samples.place.push(regime === LOADING ? (z[W] * kl) / ku : z[W]);
      samples.speed.push(z[V2]);
      samples.regime.push(regime);
    }

    function enter(before, regime, at) {
      theta = at[THETA];
      if (regime === UNLOADING && before === LOADING) {
        result.impacts += 1;
        result.impactTimes.push(begun);
        result.peakForce = Math.max(result.peakForce, ku * at[W]);
      } else if (regime === LOADING && before === FREE) {
        result.contacts += 1;
        result.contactTimes.push(begun);
        result.peakSpeed = Math.max(result.peakSpeed, at[V2]);
      }
      if (perPeriod) {
        for (let i = 0; i < 4; i++) z[i] = at[i];
        note(begun, regime, at[SINE]);
      }
    }

    function left(regime, tau) {
      // `work` still holds the regime's modes
      for (next = Math.max(next, Math.ceil(begun / spacing)); next * spacing < begun + tau; next++) {
        const t = next * spacing - begun;
        if (t <= 0) continue;
        const sine = Math.sin(theta + model[OMEGA] * t), cosine = Math.cos(theta + model[OMEGA] * t);
        if (regime === FREE) freeState(model, sine, cosine, t, z);
        else contactState(model, regime, sine, cosine, t, z);
        note(next * spacing, regime, sine);
      }
      begun += tau;
    }

    for (let n = 0; n < periods; n++) {
      advancePeriod(model, now, enter, left);
      // as the phase is put back exactly, so is the time
      begun = ((n + 1) * TURN) / model[OMEGA];
    }
    const moved = face(model, now, now[REGIME], now[ORIGIN]) - from;
    result.rate = moved / ((periods * TURN) / model[OMEGA]);
    result.end = now;
    return result;
  }

  /* The rig at the end of each of so many excitation periods from rest: places of both masses, speeds, impact times. */
  function strobe(model, periods) {
    let state = freshState(model);
    const rows = [], impactTimes = [];
    for (let n = 0; n <= periods; n++) {
      const x2 = state[ORIGIN] + state[W];
      rows.push([x2 + state[Y], x2, state[V1], state[V2], face(model, state, state[REGIME], state[ORIGIN])]);
      if (n === periods) break;
      const one = follow(model, state, 1);
      impactTimes.push(...one.impactTimes.map((t) => t + (n * TURN) / model[OMEGA]));
      state = one.end;
    }
    return { rows, impactTimes };
  }

  return { makeModel, freshState, advance, advancePeriod, follow, strobe, Orbit, LONGEST_PERIOD };
})();

if (typeof module !== "undefined") module.exports = Engine;
