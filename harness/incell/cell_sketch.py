"""Reduce the stages of a simulation step to a few numbers each, by which two releases can be compared afterwards.

A stage has many values: positions of all bodies, all contacts. They are summed with fixed weights of either sign. A
change of any value changes the sum by about as much, and equal values give equal sums on every machine, since they are
added one after another.
"""

import numpy as np

LARGEST = 1 << 16

STAGES = ("kinematics", "collision", "actuation", "passive", "bias", "acceleration", "constraint", "solver")
"""Stages of a forward pass, in their order; the model comes before them, the integrator after them."""

FIELDS = {
    "kinematics": ("xpos", "xquat", "geom_xpos", "site_xpos", "subtree_com"),
    "actuation": ("qfrc_actuator",),
    "passive": ("qfrc_passive",),
    "bias": ("qfrc_bias",),
    "acceleration": ("qacc_smooth",),
    "constraint": ("efc_pos", "efc_R", "efc_aref"),
    "solver": ("qacc", "qfrc_constraint"),
}
"""Arrays of mjData that a stage is read from. Contacts are read one by one."""


MODEL = (
    "qpos0", "body_mass", "body_inertia", "body_ipos", "body_iquat", "body_pos", "body_quat", "jnt_range",
    "jnt_stiffness", "jnt_axis", "dof_damping", "dof_armature", "dof_frictionloss", "geom_type", "geom_size",
    "geom_pos", "geom_quat", "geom_friction", "geom_solref", "geom_solimp", "geom_margin", "geom_gap",
    "actuator_gainprm", "actuator_biasprm", "actuator_gear", "actuator_ctrlrange",
)  # fmt: skip
OPTIONS = (
    "timestep", "gravity", "integrator", "cone", "solver", "iterations", "tolerance", "impratio", "disableflags",
    "enableflags",
)  # fmt: skip
"""Arrays of mjModel, and options, that change a simulation."""


def weights(count):
    """Return fixed weights between 0.5 and 1.5 and of either sign, which come from no generator."""
    index = np.arange(1, count + 1, dtype=np.uint64) * np.uint64(2654435761) + np.uint64(12345)
    bits = (index ^ (index >> np.uint64(13))) % np.uint64(65521)
    size = 0.5 + bits.astype(float) / 65521.0
    return size * np.where(bits % np.uint64(2) == 0, 1.0, -1.0)


_WEIGHTS = weights(LARGEST)


def sketch(values):
    """Return the weighted sum of an array."""
    values = np.asarray(values, dtype=float).ravel()[:LARGEST]
    return np.add.accumulate(values * _WEIGHTS[: values.size])[-1] if values.size else 0.0


class Stages:
    """The stages of MuJoCo's forward pass."""

    def __init__(self, mujoco, model, data):
        self.mujoco = mujoco
        self.model = model
        self.data = data
        self.by_vector = hasattr(data.contact, "dist")
        self.multi_stage = model.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4

    def pairs(self):
        """Return the pairs of geometry numbers in contact."""
        return [pair for pair, _ in self._contacts()]

    def _contacts(self):
        contacts = self.data.contact
        if self.by_vector:
            if not self.data.ncon:
                return []
            ends = zip(np.array(contacts.geom1).tolist(), np.array(contacts.geom2).tolist())
            rows = np.column_stack([contacts.dist, np.array(contacts.pos), np.array(contacts.frame)[:, :3]])
            sums = zip(ends, rows.tolist())
        else:
            each = [contacts[number] for number in range(self.data.ncon)]
            sums = [((c.geom1, c.geom2), [c.dist, *c.pos, *c.frame[:3]]) for c in each]
        return sorted((tuple(sorted(pair)), values) for pair, values in sums)

    def forward(self):
        """Make a forward pass from the present state and return the sum of each stage."""
        warm = np.array(self.data.qacc_warmstart)
        self.mujoco.mj_forward(self.model, self.data)
        self.data.qacc_warmstart[:] = warm
        return np.array([self._stage(name) for name in STAGES])

    def _stage(self, name):
        if name == "collision":
            return sketch([number for pair, values in self._contacts() for number in list(pair) + values])
        return sketch(np.concatenate([np.asarray(getattr(self.data, field)).ravel() for field in FIELDS[name]]))

    def inner(self):
        """Return the sums of the inner stages of a step by Runge and Kutta from the present state, a list of three."""
        if not self.multi_stage:
            return []
        data, step = self.data, self.model.opt.timestep
        start = np.array(data.qpos), np.array(data.qvel), np.array(data.act)
        velocity, acceleration, activity = start[1], np.array(data.qacc), np.array(data.act_dot)
        sums = []
        for share in (0.5, 0.5, 1.0):
            position = start[0].copy()
            self.mujoco.mj_integratePos(self.model, position, velocity, share * step)
            data.qpos[:] = position
            data.qvel[:] = start[1] + share * step * acceleration
            data.act[:] = start[2] + share * step * activity
            sums.append(self.forward())
            velocity, acceleration, activity = np.array(data.qvel), np.array(data.qacc), np.array(data.act_dot)
        data.qpos[:], data.qvel[:], data.act[:] = start
        return sums

    def names_of_starts(self, steps):
        """Name the starts that the sums of the stages are of, for an environment step of so many simulator steps."""
        inner = ["inner stage {}".format(number) for number in (2, 3, 4)] if self.multi_stage else []
        return ["step 1"] + inner + ["step {}".format(number + 2) for number in range(steps - 1)]

    def geometries(self):
        """Return name, or number, and type of each geometry."""
        mujoco, sums = self.mujoco, []
        for number in range(self.model.ngeom):
            name = mujoco.mj_id2name(self.model, mujoco.mjtObj.mjOBJ_GEOM, number)
            sums.append([name or str(number), int(self.model.geom_type[number])])
        return sums

    def rows(self):
        """Return how many rows of the constraint solver are of equalities, of limits and of contacts."""
        kinds = np.array(self.data.efc_type).ravel()[: self.data.nefc]
        return np.array([np.sum(kinds == 0), np.sum((kinds == 3) | (kinds == 4)), np.sum(kinds >= 5)])

    def model_sums(self):
        """Return size and sum of each array of the model, and of its options, by name."""
        sums = {}
        for owner, before, names in ((self.model, "", MODEL), (self.model.opt, "opt.", OPTIONS)):
            for name in names:
                if hasattr(owner, name):
                    values = np.asarray(getattr(owner, name), dtype=float)
                    sums[before + name] = [int(values.size), float(sketch(values))]
        return sums
