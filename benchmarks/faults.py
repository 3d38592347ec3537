"""One-line faults drawn at random from all modules: signs, factors, limits, indices, defaults."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Fault:
    """A fault: what stands in a file just once, and what is put in its place."""

    file: str
    right: str
    wrong: str
    tests: tuple[str, ...]
    reason: str = ""
    """Why the program is as good with it, where no test can notice it."""

    @property
    def name(self) -> str:
        """File and what is put there."""
        return f"{self.file}: {self.right} -> {self.wrong}"

    def put_into(self, text: str) -> str:
        """Put the fault into the text of its file; a fault that fits nowhere, or twice, is an error."""
        if text.count(self.right) != 1:
            raise ValueError(f"{self.name}: stands {text.count(self.right)} times in the file, expected once")
        return text.replace(self.right, self.wrong)


def _in(file: str, *changes: tuple[str, str] | tuple[str, str, str], tests: str) -> list[Fault]:
    paths = tuple(f"tests/{path}" for path in tests.split())
    package = f"continuum_grasp/{file}"
    return [Fault(package, change[0], change[1], paths, *change[2:]) for change in changes]


FAULTS: tuple[Fault, ...] = (
    *_in(
        "arguments.py",
        ("return math.inf if value > 0 else -math.inf", "return math.inf if value < 0 else -math.inf"),
        ("if not 0.0 < number < math.inf:", "if not 0.0 <= number < math.inf:"),
        tests="test_arguments.py scene",
    ),
    *_in("workers.py", ("len(pending) < self.most", "len(pending) <= self.most"), tests="test_workers.py sweeps"),
    # scene
    *_in(
        "scene/profile.py",
        ("(_NODES + 1.0), 0.5 * (b - a) * _WEIGHTS", "(_NODES + 1.0), 0.505 * (b - a) * _WEIGHTS"),
        tests="scene/test_graded_rods.py model/test_graded.py",
    ),
    *_in(
        "scene/grasp.py",
        ("body.normal_angle + math.pi - first - k * step", "body.normal_angle + math.pi - first + k * step"),
        tests="scene grasp/test_grasp_starts.py grasp/test_grasp_gaps.py",
    ),
    *_in(
        "scene/parts.py",
        ("(a[1] > y) != (b[1] > y) and x <", "(a[1] > y) == (b[1] > y) and x <"),
        tests="scene model/test_contact_surface.py",
    ),
    *_in(
        "scene/objects/outline.py",
        ("[(x * scale, y * scale)", "[(x * scale, -y * scale)"),
        tests="scene/test_outlines.py",
    ),
    *_in(
        "scene/supports.py",
        ("self.axis_angle - half + 0.5 * math.pi", "self.axis_angle + half + 0.5 * math.pi"),
        tests="scene grasp/test_grasp_stations.py grasp/test_grasp_starts.py",
    ),
    *_in(
        "scene/drives.py",
        ('excludes("drives", "slack", "pretension"', 'needs("drives", "slack", "pretension"'),
        tests="scene simulation/test_winches.py",
    ),
    *_in(
        "scene/value.py",
        ("if abs(count - round(count)) > 1e-6 * count:", "if abs(count - round(count)) > 1e-2 * count:"),
        tests="scene simulation/test_simulation.py",
    ),
    # rod
    *_in(
        "rod/equations.py",
        ("slope = (8.0 + v * (12.0 - 4.0 * v * v)) / 16.0", "slope = (8.0 + v * (12.0 + 4.0 * v * v)) / 16.0"),
        tests="rod",
    ),
    *_in(
        "rod/dense_rod.py",
        ("-np.sin(angle) @ lever, np.cos", "np.sin(angle) @ lever, np.cos"),
        tests="rod simulation/test_modes.py",
    ),
    *_in(
        "rod/elastica.py",
        ("np.all((at >= -1e-12) & (at <= 1.0 + 1e-12))", "np.all((at >= -1e-12) & (at <= 1.1 + 1e-12))"),
        tests="rod",
    ),
    *_in(
        "rod/equilibrium_path.py",
        ("length > 0.5 * size or", "length > 50.0 * size or"),
        tests="rod simulation/test_statics.py",
    ),
    # model
    *_in(
        "model/laws/limits.py",
        ("(s * s / root)", "(s * s / (1.01 * root))"),
        ("sign * (bend.curvature + bend.rest if", "sign * (bend.curvature - bend.rest if"),
        tests="scene/test_stops.py model/test_softening.py model/test_section_laws.py",
    ),
    *_in(
        "model/laws/relaxation.py",
        ("points(family, family.degree + 1)", "points(family, 1)"),
        ("bend.rate, 1.0 / time)", "bend.rate, 1.01 / time)"),
        tests="model/test_section_laws.py",
    ),
    *_in(
        "model/sweep.py",
        ("forces -= shapes * (measure * law.moment(bend))", "forces -= shapes * (1.01 * measure * law.moment(bend))"),
        tests="model/test_section_laws.py",
    ),
    *_in(
        "model/memory.py",
        ("return [clipped(z + self.moved * slid)", "return [clipped(z + 1.01 * self.moved * slid)"),
        tests="simulation/test_tendon_friction.py simulation/test_dry_friction.py",
    ),
    *_in(
        "model/body.py",
        ("self.arm.perp().scaled(self.omega)", "self.arm.perp().scaled(-self.omega)"),
        tests="model/test_system.py",
    ),
    *_in(
        "model/collocated.py",
        ("longer(kernel + end * h**2 * np.outer(w, w)),", "longer(1.01 * kernel + end * h**2 * np.outer(w, w)),"),
        tests="model/test_graded.py model/test_model_truth.py",
    ),
    *_in(
        "model/surfaces/surface.py",
        (
            "(bend * ca.sumsqr(off) + 2.0 * along) / (1.0 + reach)",
            "(bend * ca.sumsqr(off) + 2.0 * along) / (1.01 + reach)",
        ),
        tests="model/test_contact_surface.py grasp/test_grasp_problem.py",
    ),
    *_in(
        "model/surfaces/superellipse.py",
        ("low = self._table[np.maximum(best - 1, 0)]", "low = self._table[np.maximum(best, 0)]"),
        tests="model/test_contact_surface.py grasp/test_grasp_problem.py",
    ),
    *_in(
        "model/surfaces/offset_polygon.py",
        ("corner = ax == bx and ay == by", "corner = ax != bx and ay == by"),
        tests="model/test_contact_surface.py grasp/test_grasp_problem.py",
    ),
    *_in(
        "model/quadrature.py",
        ("if angle_range <= reach), None)", "if angle_range <= 1.5 * reach), None)"),
        tests="model/test_ranges.py model/test_model_truth.py",
    ),
    *_in(
        "model/planar.py",
        ("for k in range(j + 1, i + 1):", "for k in range(j, i + 1):"),
        tests="model/test_model_truth.py model/test_many_elements.py",
    ),
    # core
    *_in(
        "core/integrators/ros2.py",
        ("x + 1.5 * h * first + 0.5 * h * second", "x + 1.5 * h * first - 0.5 * h * second"),
        tests="core/test_core.py",
    ),
    *_in(
        "core/integrators/rk4.py",
        ("x + h / 6 * (k1 + 2 * (k2 + k3) + k4)", "x + h / 6 * (k1 + 2.02 * (k2 + k3) + k4)"),
        tests="core/test_core.py",
    ),
    *_in(
        "core/integrators/implicit_midpoint.py",
        ("missing = m - x - 0.5 * h * rate", "missing = m - x - 0.505 * h * rate"),
        tests="core",
    ),
    *_in(
        "core/batches.py",
        ("result[:, t * result.shape[1] // steps]", "result[:, 0 * result.shape[1] // steps]"),
        tests="core",
    ),
    *_in(
        "core/rollouts.py", ("states[k + 1 : k + 1 + len(following)]", "states[k : k + len(following)]"), tests="core"
    ),
    # nlp
    *_in(
        "nlp/optimality.py",
        (
            "gradient + np.array(jacobian.T @ forces).ravel() + bounds",
            "gradient + np.array(jacobian.T @ forces).ravel() - bounds",
        ),
        ("np.maximum(low - at, at - high), 0.0)", "np.maximum(low - at, at - high), 1e-3)"),
        tests="nlp",
    ),
    *_in(
        "nlp/solver.py",
        ("if error <= tolerance and violation <= constraint_tolerance:", "if error <= tolerance:"),
        tests="nlp",
    ),
    # simulation
    *_in(
        "simulation/signals.py",
        ("-15 * rise + 8 * a + 7 * b", "-15 * rise + 8 * a + 8 * b"),
        tests="simulation/test_signals.py simulation/test_simulation.py",
    ),
    *_in(
        "simulation/static_shape.py",
        (
            "np.clip(states + moved * slid(model, q, u, p), -1.0, 1.0)",
            "np.clip(states + moved * slid(model, q, u, p), -1.0, 1.01)",
        ),
        tests="simulation/test_tendon_friction.py simulation/test_dry_friction.py simulation/test_drives_at_rest.py",
    ),
    *_in(
        "simulation/modes.py",
        ("pulsations <= _ROUNDING * pulsations", "pulsations <= 1e4 * _ROUNDING * pulsations"),
        tests="simulation/test_modes.py",
    ),
    *_in(
        "simulation/contacts.py",
        ("np.maximum(0.0, (half - distances).max(axis=1))", "np.maximum(0.0, (half - distances).min(axis=1))"),
        tests="simulation/test_simulation_contact.py",
    ),
    # accuracy
    *_in("accuracy/motion.py", ("if error <= tolerance:", "if error <= 2.0 * tolerance:"), tests="accuracy"),
    *_in(
        "accuracy/choice.py",
        ("reach = _MARGIN * truth.curvature_reach", "reach = 0.5 * _MARGIN * truth.curvature_reach"),
        tests="accuracy",
    ),
    # grasp
    *_in(
        "grasp/certificate/surfaces.py",
        ("core + radius * normal, normal, np.full", "core - radius * normal, normal, np.full"),
        tests="grasp/test_grasp_surfaces.py",
    ),
    *_in(
        "grasp/certificate/drives.py",
        ("position + torque / drive.position_gain", "position - torque / drive.position_gain"),
        tests="grasp/test_grasp_drives.py grasp/test_grasp_certificate.py",
    ),
    *_in(
        "grasp/certificate/stability.py",
        ("section = np.eye(size)[start + node]", "section = 1.01 * np.eye(size)[start + node]"),
        tests="grasp/test_grasp_stability.py",
    ),
    *_in(
        "grasp/certificate/check.py",
        ("c.held_friction * n", "1.01 * c.held_friction * n"),
        tests="grasp/test_grasp_certificate.py grasp/test_grasp_limits.py",
    ),
    *_in(
        "grasp/bound.py", ("(1.0 + mu**2)) / size)", "(1.0 + 1.02 * mu**2)) / size)"), tests="grasp/test_grasp_bound.py"
    ),
    *_in(
        "grasp/certificate/held.py",
        ("return min(_missing(states", "return max(_missing(states"),
        tests="grasp/test_grasp_tampering.py",
    ),
    *_in(
        "grasp/quality/resistance.py",
        ("high = float(min(2.0 * spare[0][0]", "high = float(min(1.0 * spare[0][0]"),
        tests="grasp/test_grasp_quality.py grasp/test_grasp_response.py",
    ),
    *_in(
        "grasp/robust/response.py",
        ("return self.reserve >= HOLDS", "return self.reserve >= -1.0"),
        tests="grasp/test_grasp_robust.py grasp/test_grasp_response.py",
    ),
    *_in(
        "grasp/problem/equations.py",
        ("(repr(spec), *versions,", "(repr(spec.fingers), *versions,"),
        ('"model", "nlp", "scene")', '"nlp", "scene")'),
        ("f(x, p), g(x, p), p, derivatives)", "f(x, p), -g(x, p), p, derivatives)"),
        tests="grasp/test_grasp_equations.py",
    ),
    *_in(
        "core/cache.py",
        ("key=os.path.getmtime)[:-stored]", "key=os.path.getmtime)[stored:]"),
        tests="grasp/test_grasp_equations.py",
    ),
    *_in(
        "grasp/robust/share.py",
        ("softer, heavier = 1.0 / (1.0 + stiffness)", "softer, heavier = (1.0 + stiffness)"),
        tests="grasp/test_grasp_share.py",
    ),
    # design, sweeps
    *_in(
        "design/held.py",
        ("hessian + np.diag(under + over + _REGULAR)", "hessian + np.diag(under - over + _REGULAR)"),
        tests="design",
    ),
    *_in(
        "design/manufacture.py",
        ("row.value + float(np.abs(row.slope[n:]).sum())", "row.value - float(np.abs(row.slope[n:]).sum())"),
        tests="design",
    ),
    *_in(
        "sweeps/plan.py",
        ("value = low + (high - low) * share", "value = low + (high + low) * share"),
        ("fast_forward(draw + 1)", "fast_forward(draw)"),
        tests="sweeps",
    ),
    *_in(
        "sweeps/maps.py",
        ("place = row[rows[0]], column[rows[0]]", "place = column[rows[0]], row[rows[0]]"),
        tests="sweeps",
    ),
    # control
    *_in(
        "control/ocp/setpoints.py",
        ("setpoint.phase + 2.0 * math.pi", "setpoint.phase + 2.02 * math.pi"),
        tests="control/test_setpoints.py",
    ),
    *_in(
        "control/ocp/scene_problem.py",
        ("change = (model.u - held) / horizon.stage", "change = (model.u + held) / horizon.stage"),
        tests="control/test_control_problem.py control/test_cost_terms.py",
    ),
    *_in(
        "control/estimation/excitation.py",
        ("(1.0 - share) * np.eye(nx)", "(1.01 - share) * np.eye(nx)"),
        tests="control/test_adaptation.py control/test_estimator.py",
    ),
    *_in(
        "control/estimation/free_finger.py",
        ("reach[0] * normal[1] - reach[1] * normal[0]", "reach[0] * normal[1] + reach[1] * normal[0]"),
        tests="control/test_contact_detector.py",
    ),
    *_in(
        "control/c/rti_active_set.c",
        ("multiplier < b->penalty ? RTI_AT_HIGH", "multiplier > b->penalty ? RTI_AT_HIGH"),
        tests="control/test_rti_qp.py",
    ),
    *_in(
        "control/c/rti_search.c",
        ("if (o->full && now <= RTI_CONVERGES * last)", "if (o->full && now >= RTI_CONVERGES * last)"),
        tests="control/test_rti.py",
    ),
    *_in(
        "control/c/ekf.c",
        ("if (out && *bucket <= (real)EKF_PATIENCE)", "if (out && *bucket <= 10 * (real)EKF_PATIENCE)"),
        tests="control/test_estimator.py",
    ),
    # planning
    *_in(
        "planning/guess.py",
        ("tau**3 * (10.0 - 15.0 * tau + 6.0 * tau**2)", "tau**3 * (10.0 - 15.0 * tau - 6.0 * tau**2)"),
        tests="planning",
    ),
    *_in(
        "planning/fine.py",
        (
            "if deviation.final_tip <= _FINER_OFF * plan.length:",
            "if deviation.final_tip <= 100.0 * _FINER_OFF * plan.length:",
        ),
        tests="planning",
    ),
    *_in(
        "planning/goal.py",
        ("ca.vec(model.sections(goal.shape.at)(x, u, p)[0])", "ca.vec(model.sections(goal.shape.at)(x, u, p)[0].T)"),
        tests="planning",
    ),
    # closed_loop
    *_in(
        "closed_loop/readings.py",
        ("return whole[1:] - whole[:-1]", "return whole[1:] + whole[:-1]"),
        tests="closed_loop",
    ),
    *_in(
        "closed_loop/plant_model.py",
        ("lambda s: 1.0 / finger.profile.bending_stiffness(s)", "lambda s: 1.01 / finger.profile.bending_stiffness(s)"),
        tests="closed_loop",
    ),
    *_in(
        "closed_loop/chain_system.py",
        ("ca.fmin(ca.fmax(loss / greatest_loss, -1.0), 1.0)", "ca.fmin(ca.fmax(loss / greatest_loss, 0.0), 1.0)"),
        tests="closed_loop",
    ),
    # mission
    *_in(
        "mission/assign.py",
        (
            "first, last = stations[0], finger.rod.length - stations[-1]",
            "first, last = stations[0], finger.rod.length - stations[0]",
        ),
        tests="mission",
    ),
    *_in(
        "mission/budget.py",
        ("lift = lift * mass / scene.object.mass", "lift = lift * scene.object.mass / mass"),
        tests="mission/test_mission_certificate.py",
    ),
    *_in(
        "mission/plan.py",
        ("np.where(low > -ABSENT, of.held, low)", "np.where(low < -ABSENT, of.held, low)"),
        tests="mission/test_mission_lift.py",
    ),
    *_in(
        "control/c/mission.c",
        ("bears && reported == MISSION_BEARS", "bears || reported == MISSION_BEARS"),
        ("row[j] - state->left[j]", "row[j] + state->left[j]"),
        tests="mission/test_mission_lift.py",
    ),
    *_in(
        "model/laws/shortening.py",
        ("shares.append(1.0 / (1.0 + strain))", "shares.append(1.0 / (1.0 - strain))"),
        tests="model/test_shortening.py",
    ),
    # identification
    *_in(
        "identification/read.py",
        ('-1.0 if axis[0] == "-" else 1.0', '1.0 if axis[0] == "-" else 1.0'),
        tests="identification",
    ),
    *_in(
        "scene/table.py",
        ("if not value >= _SURE", "if value >= _SURE"),
        tests="identification",
    ),
    *_in(
        "identification/information.py",
        ('"...ri,...rj->...ij", scaled, scaled', '"...ri,...rj->...ij", scaled, jacobian'),
        tests="identification/test_experiments.py",
    ),
    *_in(
        "identification/searches.py",
        ("key=lambda k: (numbers[k], errors[k])", "key=lambda k: (-numbers[k], errors[k])"),
        tests="identification/test_laws.py",
    ),
    *_in(
        "identification/observation.py",
        ("return model.orientation(q, u, s, p) - base", "return model.orientation(q, u, s, p) + base"),
        tests="identification",
    ),
    *_in(
        "identification/periods.py",
        ("self.t - 1e-3 * period, math.inf", "self.t + 1e-3 * period, math.inf"),
        ("order[[a, b]] = b, a", "order[[a, b]] = a, b"),
        tests="identification/test_replay.py",
    ),
    *_in(
        "identification/replayed.py",
        (
            "suspicions.sort(key=lambda suspicion: suspicion.after)",
            "suspicions.sort(key=lambda suspicion: -suspicion.after)",
        ),
        tests="identification/test_replay.py",
    ),
    # export
    *_in(
        "export/strict_math.py",
        ("return np.where(x > 0, root,", "return np.where(x > 1, root,"),
        tests="export/test_export_kernels.py export/test_export.py",
    ),
    *_in(
        "export/ranges.py",
        ("return -max(20.0, 2.0 * abs(nominal)), max(", "return max(20.0, 2.0 * abs(nominal)), max("),
        tests="export/test_export.py export/test_export_uses.py",
    ),
    *_in(
        "export/mjcf/controls.py",
        ("self.start + self.sense *", "self.start - self.sense *"),
        tests="export/test_export_mjcf.py",
    ),
    *_in(
        "export/control/replay.py",
        ("noise * self._rng.standard_normal(len(noise))", "0.0 * self._rng.standard_normal(len(noise))"),
        tests="export/test_export_control.py",
    ),
    # environments, operators
    *_in(
        "environments/spaces.py",
        ("np.nextafter(low, np.float32(-np.inf))", "np.nextafter(low, np.float32(np.inf))"),
        tests="environments",
    ),
    *_in(
        "environments/substeps.py",
        ("commands = rest + share * (commands - rest)", "commands = rest + share * commands"),
        tests="environments",
    ),
    *_in(
        "environments/sensing.py", ("cost = 0.5 * plants.period", "cost = 0.505 * plants.period"), tests="environments"
    ),
    *_in(
        "operators/derivatives.py",
        ("[k + 1 for k in self.like], self.back", "[k + 1 for k in self.like], not self.back"),
        tests="operators",
    ),
    # results, plotting, cli
    *_in(
        "results/animation.py",
        ("instants[0] + speed * np.arange(count) / fps", "instants[0] + np.arange(count) / fps"),
        tests="results plotting",
    ),
    *_in(
        "results/run_folder.py", ("if version > FORMAT_VERSION:", "if version > FORMAT_VERSION + 1:"), tests="results"
    ),
    *_in(
        "plotting/mission.py",
        ("np.searchsorted(t, start - 1e-9)", "np.searchsorted(t, start + 1.0)"),
        tests="plotting mission",
    ),
    *_in("grasp/tried.py", ("round(SECTORS * turn) % SECTORS", "round(SECTORS * turn)"), tests="grasp"),
    *_in(
        "model/winches.py",
        ("_RESTING_STEPS = 1", "_RESTING_STEPS = 0"),
        ("ca.fmax(self.torque(command), 0.0) / self.radius", "self.torque(command) / self.radius"),
        tests="simulation/test_drives_at_rest.py simulation/test_winches.py",
    ),
    *_in(
        "grasp/problem/graded_backbone.py",
        ("leaning = (first - middle * drawn)", "leaning = (first + middle * drawn)"),
        tests="grasp/test_graded_grasps.py",
    ),
    *_in(
        "grasp/certificate/friction.py",
        ("stiffness(s) / stiffness(np.zeros(1))", "stiffness(s) / stiffness(0.1 * np.ones(1))"),
        ("early, late = self._halves[1].T", "early, late = self._halves[0].T"),
        tests="grasp/test_graded_grasps.py",
    ),
)
