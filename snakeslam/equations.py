"""The paper's equations in their corrected form, each with its home in the code and the test that names it.

[Tang24] Tang, Zhang, Sun, Li, Tang, Bai, "Simultaneous Localization and Mapping Methods for Snake-like Robots Based on
Gait Adjustment", Biomimetics 2024, 9, 710. Conventions: joint n and arc length s run from tail to head, g_W =
(0, 0, +9.81) in (22)-(27) as in the paper.
"""

from dataclasses import dataclass

from snakeslam.errors import InputError


@dataclass(frozen=True, slots=True)
class Equation:
    """One equation; ``home`` (dotted name) and ``test`` (file) are None until it is built."""

    number: int
    title: str
    formula: str
    home: str | None = None
    test: str | None = None
    note: str = ""

    def describe(self) -> str:
        """Return what ``snakeslam eq`` prints."""
        lines = [f"Eq. ({self.number}) {self.title}", "", *(f"    {line}" for line in self.formula.splitlines()), ""]
        lines += [self.note, ""] if self.note else []
        lines.append(f"home: {self.home or 'not built yet'}")
        lines.append(f"test: {self.test or 'not built yet'}")
        return "\n".join(lines)


GAIT_MODELS = "tests/estimation/test_gait_models.py"
PLANAR = "tests/estimation/test_planar.py"
PREINTEGRATION = "tests/estimation/test_preintegration.py"
SUMS = ("snakeslam.estimation.filter.preintegration.preintegrate", PREINTEGRATION)
DIRECTION, POSITION = "snakeslam.head.direction", "snakeslam.head.position"
DIRECTION_TEST, POSITION_TEST = "tests/head/test_direction.py", "tests/head/test_position.py"
GAIT = ("snakeslam.gaits.parametric.joint_angles", "tests/gaits/test_parametric.py")

EQUATIONS: dict[int, Equation] = {
    equation.number: equation
    for equation in (
        Equation(
            1,
            "Parameterised gait: joint angles",
            "alpha(n, t) = beta_o + A_o sin(theta_o)            n odd (yaw)\n"
            "            = beta_e + A_e sin(theta_e + delta)    n even (pitch)",
            *GAIT,
        ),
        Equation(
            2,
            "Parameterised gait: phase",
            "theta_o = k_o n + omega_o t,   theta_e = k_e n + omega_e t",
            *GAIT,
            note="Applies to each family of joints separately.",
        ),
        Equation(3, "Heading rate at the neck's start", "dphi_M/dt = k(s_M, t) v", DIRECTION, DIRECTION_TEST),
        Equation(4, "Heading along the neck", "phi_N - phi_M = int_{s_M}^{s_N} k(s, t) ds", DIRECTION, DIRECTION_TEST),
        Equation(
            5,
            "Heading rate of the head",
            "dphi_N/dt = dphi_M/dt + int_{s_M}^{s_N} dk/dt ds",
            DIRECTION,
            DIRECTION_TEST,
            note="Printed without the dot over k.",
        ),
        Equation(
            6,
            "Condition of a head that does not turn",
            "dphi_M/dt = - int_{s_M}^{s_N} dk/dt ds",
            DIRECTION,
            DIRECTION_TEST,
            note="Printed without the dot over k.",
        ),
        Equation(
            7,
            "Law of head direction control",
            "int_{s_M}^{s_N} dk/dt ds = - k(s_M, t) v",
            DIRECTION,
            DIRECTION_TEST,
            note="Printed without the dot over k.",
        ),
        Equation(8, "Its initial condition", "int_{s_M}^{s_N} k(s, t) ds = - phi_M(t)", DIRECTION, DIRECTION_TEST),
        Equation(
            9,
            "Neck as an arc: rate of its curvature",
            "dc_M/dt = - k(s_M, t) v / l_N,   c_M = - phi_M / l_N",
            f"{DIRECTION}.arc_curvature",
            DIRECTION_TEST,
            note="Printed with a stray t and l_M for the neck's length l_N.",
        ),
        Equation(
            10,
            "Curvature with a neck that is an arc",
            "k(s, t) = - alpha b sin(b s + sigma)    s < s_M\n"
            "        = - phi_M / l_N                 s_M < s < s_N,      b = 2 pi / L",
            f"{DIRECTION}.curvature",
            DIRECTION_TEST,
        ),
        Equation(
            11,
            "Heading with a neck that is an arc",
            "phi(s, t) = alpha cos(b s + sigma)                              s < s_M\n"
            "          = (1 - (s - s_M)/l_N) alpha cos(b s_M + sigma)        s_M < s < s_N\n"
            "          = 0                                                   s > s_N",
            f"{DIRECTION}.heading",
            DIRECTION_TEST,
            note="Printed with cos(b s + sigma) in the neck, which also reaches 0 but is no arc.",
        ),
        Equation(
            12,
            "Joint angles from the heading",
            "angle_i = phi(2 i l_0) - phi((2 i - 2) l_0)",
            f"{DIRECTION}.joint_angles",
            DIRECTION_TEST,
        ),
        Equation(
            13,
            "Lateral speed at the neck's start",
            "dy_M/dt = + v sin(phi_M)",
            f"{POSITION}.lateral_speed",
            POSITION_TEST,
            note="Printed with a minus, which contradicts (15).",
        ),
        Equation(
            14,
            "Lateral position of the head",
            "y_N = y_M + int_{s_M}^{s_N} sin( phi_M + int_{s_M}^{s} k ds' ) ds",
            f"{POSITION}.head_offset_m",
            POSITION_TEST,
        ),
        Equation(
            15,
            "Condition of a head that does not sway",
            "d/dt int_{s_M}^{s_N} sin( int_s^{s_N} k ds' ) ds = - v sin( int_{s_M}^{s_N} k ds )",
            f"{POSITION}.head_offset_m",
            POSITION_TEST,
            note="The left side is the derivative of the integral; s_H is s_N.",
        ),
        Equation(
            16,
            "Neck of two arcs: curvature",
            "k(s, t) = c_M + f_M    s_M < s < s_M + l_N/2\n        = c_M - f_M    s > s_M + l_N/2",
            POSITION,
            POSITION_TEST,
        ),
        Equation(
            17,
            "Neck of two arcs: rate of the difference",
            "df_M/dt = v (4 c_M - 2 k(s_M, t)) / l_N",
            f"{POSITION}.difference_rate",
            POSITION_TEST,
            note="Printed without v.",
        ),
        Equation(
            18,
            "Its integration",
            "f_M(t_{k+1}) = f_M(t_k) + df_M/dt dt",
            f"{POSITION}.step_difference",
            POSITION_TEST,
            note="Drifts: f(0) = 0 leaves up to .7 m of head offset at .5 pi; the drift-free form solves y_N = 0.",
        ),
        Equation(
            19,
            "Curvature with a neck of two arcs",
            "k(s, t) = - alpha b sin(b s + sigma)    s < s_M\n"
            "        = c_M + f_M                     s_M < s < s_M + l_N/2\n"
            "        = c_M - f_M                     s > s_M + l_N/2",
            f"{POSITION}.curvature",
            POSITION_TEST,
        ),
        Equation(
            20,
            "Heading with a neck of two arcs",
            "phi(s, t) = alpha cos(b s + sigma)                                  s < s_M\n"
            "          = (1 - (s - s_M)/l_N) phi_M + f_M (s - s_M)               s_M < s < s_M + l_N/2\n"
            "          = (1 - (s - s_M)/l_N) phi_M + f_M (s_N - s)               s > s_M + l_N/2",
            f"{POSITION}.heading",
            POSITION_TEST,
            note="As printed, the last piece leaves the head's yaw off by f l_N / 2.",
        ),
        Equation(
            21,
            "Joint angles from the heading",
            "angle_i = phi(2 i l_0) - phi((2 i - 2) l_0)",
            f"{DIRECTION}.joint_angles",
            POSITION_TEST,
        ),
        Equation(
            22,
            "What the IMU measures",
            "omega_m = omega_b + b_g + n_g\na_m = a_b + b_a + R_w^b g^w + n_a",
            *SUMS,
        ),
        Equation(
            23,
            "Position, velocity, attitude over a frame interval",
            "p_{k+1} = p_k + v_k dt + iint { R_b^w (a_m - b_a - n_a) - g^w } dt^2\n"
            "v_{k+1} = v_k + int { R_b^w (a_m - b_a - n_a) - g^w } dt\n"
            "q_{k+1} = q_k * int 1/2 Omega(omega_m - b_g - n_g) q_t^{b_k} dt",
            *SUMS,
        ),
        Equation(
            24,
            "The rate matrix of quaternions [x y z w]",
            "Omega(w) = [ -[w]x  w ; -w^T  0 ]",
            *SUMS,
        ),
        Equation(
            25,
            "Pre-integration: the world taken out",
            "R_w^k p_{k+1} = R_w^k (p_k + v_k dt - 1/2 g^w dt^2) + alpha\n"
            "R_w^k v_{k+1} = R_w^k (v_k - g^w dt) + beta\n"
            "q_w^k * q_{k+1} = gamma",
            "snakeslam.estimation.filter.preintegration",
            PREINTEGRATION,
            note="Comes from multiplying (23), not (24), by R_w^{b_k}; alpha's superscript is b_k.",
        ),
        Equation(
            26,
            "Pre-integrated quantities",
            "alpha = iint R_{b_t}^{b_k} (a_m - b_a - n_a) dt^2\n"
            "beta  = int R_{b_t}^{b_k} (a_m - b_a - n_a) dt\n"
            "gamma = int 1/2 Omega(omega_m - b_g - n_g) gamma_t dt",
            *SUMS,
            note="The rotation is R_{b_t}^{b_k}, omega the measured one. To first order in the biases:\n"
            "alpha ~ alpha^ + J_a db_a + J_g db_g (beta alike), gamma ~ gamma^ * [J db_g / 2, 1].",
        ),
        Equation(
            27,
            "Pre-integration residual, 15 rows",
            "R_w^k (p_{k+1} - p_k - v_k dt + 1/2 g^w dt^2) - alpha\n"
            "R_w^k (v_{k+1} - v_k + g^w dt) - beta\n"
            "2 [ q_w^k * q_{k+1} * gamma^-1 ]_xyz\n"
            "b_a,{k+1} - b_a,k\n"
            "b_g,{k+1} - b_g,k",
            "snakeslam.estimation.filter.preintegration.Preintegrated.residual",
            PREINTEGRATION,
            note="Printed with - g dt in the velocity row and the accelerometer's bias twice.",
        ),
        Equation(
            28,
            "Centre of mass",
            "p = 1/N [ e^T X ; e^T Y ]",
            "snakeslam.estimation.planar.models.centre_of_mass",
            GAIT_MODELS,
            note="The sums run to N.",
        ),
        Equation(
            29,
            "Links joined end to end",
            "D X + l A cos(theta) = 0,   D Y + l A sin(theta) = 0",
            "snakeslam.estimation.planar.models.Rods.gaps",
            GAIT_MODELS,
        ),
        Equation(
            30,
            "Links from the centre of mass and the angles",
            "T X = [ -l A cos(theta) ; p_x ],   T Y = [ -l A sin(theta) ; p_y ]\n"
            "T = [ D ; e^T/N ],   T^-1 = [ D^T (D D^T)^-1, e ]",
            "snakeslam.estimation.planar.models.Rods.positions",
            GAIT_MODELS,
        ),
        Equation(
            31,
            "Velocities of the links",
            "dX/dt = l K^T S_theta dtheta/dt + e dp_x/dt\n"
            "dY/dt = - l K^T C_theta dtheta/dt + e dp_y/dt,      K = A^T (D D^T)^-1 D",
            "snakeslam.estimation.planar.models.Rods.velocities",
            GAIT_MODELS,
            note="K is not defined in print. An identity: dp and the turn come from a law of friction (Rods.twist).",
        ),
        Equation(
            32,
            "Arc rolling: the links on the ground",
            "v_wheel = omega r",
            "snakeslam.estimation.planar.models.wheel_speed",
            GAIT_MODELS,
        ),
        Equation(
            33,
            "Arc rolling: the lifted link",
            "r_l = l sin(A/2 cos(omega t)),   theta = omega t",
            "snakeslam.estimation.planar.models.swing_radius",
            GAIT_MODELS,
        ),
        Equation(
            34,
            "Arc rolling: its velocity",
            "v_x = d/dt ( r_l cos theta ),   v_z = d/dt ( r_l sin theta )",
            "snakeslam.estimation.planar.models.swing_velocity",
            GAIT_MODELS,
        ),
        Equation(
            35,
            "Arc rolling: forward speed",
            "v(t) = v_wheel + v_x    0 < t <= T/4\n     = v_wheel          T/4 < t <= T/2",
            "snakeslam.estimation.planar.models.paper_rolling_speed",
            GAIT_MODELS,
        ),
        Equation(
            36,
            "Arc rolling: forward speed, written out",
            "v = omega r - omega l [ A/2 cos(A/2 cos(omega t)) sin(omega t) cos(omega t)\n"
            "                        + sin(A/2 cos(omega t)) sin(omega t) ]",
            "snakeslam.estimation.planar.models.lifting_speed",
            GAIT_MODELS,
            note="Follows from (34), but a planar arc lies flat and lifts nothing. Better: the links' normals n fan\n"
            "over +-N A/4, V = argmin int |V - omega r n(s)| ds (gait_models.fan_rolling_speed).",
        ),
        Equation(
            37,
            "State of the planar filter",
            "x = [ p_x, p_y, theta, v, omega ]^T",
            "snakeslam.estimation.planar.state.PlanarState",
            PLANAR,
        ),
        Equation(
            38,
            "Its motion",
            "x_{k+1} = f(x_k, u_k, dt) + w_k\n"
            "p += v dt (cos theta, sin theta),   theta += omega dt,   v and omega from the motion model",
            "snakeslam.estimation.planar.state.move",
            PLANAR,
            note="f is not given in print.",
        ),
        Equation(
            39,
            "Its measurement",
            "z_k = h(x_k) + v_k",
            "snakeslam.estimation.planar.state.observe",
            PLANAR,
            note="z is the head's (x, y, yaw) of vision and IMU, h = (p + R(theta) r_V, theta + psi), r_V and psi\n"
            "from the joints.",
        ),
        Equation(
            40,
            "Its prediction",
            "x_{k|k-1} = f(x_{k-1|k-1}, u_{k-1}, dt)\nP_{k|k-1} = F P_{k-1|k-1} F^T + G Q G^T",
            "snakeslam.estimation.planar.state.PlanarState.predict",
            PLANAR,
            note="F is taken at x_{k-1|k-1}.",
        ),
        Equation(
            41,
            "Iterated update on the manifold",
            "x_0 = x^\nx_{j+1} = x^ [+] K_j [ z [-] h(x_j) + H_j (x_j [-] x^) ],   H_j, K_j at x_j\nP = (I - K H) P",
            "snakeslam.estimation.filter.ieskf.update",
            "tests/estimation/test_ieskf.py",
            note="Printed without the iteration. The covariance is transported by J_j^-1; it stops when dx is\n"
            "small or the cost rises.",
        ),
    )
}


def equation(number: int) -> Equation:
    """Return one equation; InputError when the paper has none of this number."""
    if number not in EQUATIONS:
        raise InputError("eq", str(number), f"1 to {max(EQUATIONS)}")
    return EQUATIONS[number]
