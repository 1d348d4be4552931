"""Drive raw PyBullet: `pybullet:direct` is a scene of ours, `pybullet:FILE.urdf` a robot on its floor.

The file lies where the cell runs, or among those of pybullet_data.
"""

import importlib

from .cell_adapter import Adapter, Environment
from .cell_callables import local_name
from .cell_errors import library, violate

PACKAGES = {"pybullet": "pybullet"}
IDS = r"direct|.+\.(urdf|sdf|xml)"
EXAMPLE = "pybullet:direct"
BRINGS_MODELS = True

HEIGHT, WIDTH = 240, 320
SCENE = "direct"
GRAVITY = -9.81
STRONGEST = 1.0
"""What a motor gives at most, in N m (or N, where it pushes)."""

RED, BLUE, GREEN, GREY = (1, 0, 0, 1), (0, 0, 1, 1), (0, 1, 0, 1), (0.6, 0.6, 0.6, 1)
PICTURE = {"above": "#ff0000", "below": "#0000ff"}
"""Two boxes of the scene: the red one above the blue one."""


class Bullet(Adapter):
    """The calls of a user: connect(DIRECT), stepSimulation, getCameraImage with the TinyRenderer."""

    imports = ("pybullet",)

    def make(self, case, report, draw=False):
        """Connect to a simulation of its own, without a window."""
        name = local_name(case)
        if name != SCENE and not name.endswith((".urdf", ".xml", ".sdf")):
            message = "no scene and no file: {!r}; write pybullet:{}, or a file such as pybullet:kuka_iiwa/model.urdf"
            raise LookupError(message.format(name, SCENE))
        return Simulation(importlib.import_module("pybullet"), name, report)

    def picture_colours(self, case):
        """Return the colours of the scene of ours."""
        return PICTURE if local_name(case) == SCENE else None


class Simulation(Environment):
    """Bodies whose joints get random torques; the same start each time, no reward, no end."""

    def __init__(self, bullet, name, report):

        super().__init__(report)
        self.bullet = bullet
        self.name = name
        self.states = []
        with library:
            self.here = {"physicsClientId": bullet.connect(bullet.DIRECT)}
            if not getattr(bullet, "isNumpyEnabled", lambda: 1)():
                report("type", "pybullet.no_numpy")

    def begin(self, seed):
        """Build the scene again, as documented: a reset deletes the saved states of a simulation."""
        bullet, here = self.bullet, self.here
        bullet.resetSimulation(**here)
        self.states = []
        bullet.setGravity(0, 0, GRAVITY, **here)
        bodies = scene(bullet, here) if self.name == SCENE else [floor(bullet, here), *robot(bullet, here, self.name)]
        self.bodies = bodies
        movable = (bullet.JOINT_REVOLUTE, bullet.JOINT_PRISMATIC)
        joints = [(body, joint) for body in bodies for joint in range(bullet.getNumJoints(body, **here))]
        self.joints = [pair for pair in joints if bullet.getJointInfo(*pair, **here)[2] in movable]
        for pair in self.joints:  # the motor that each joint has from the start would hold it still
            bullet.setJointMotorControl2(*pair, controlMode=bullet.VELOCITY_CONTROL, force=0, **here)
        return self._observed()

    def advance(self, action):
        """Make one step of the simulation, of 1/240 s."""
        bullet = self.bullet
        for pair, torque in zip(self.joints, action):
            bullet.setJointMotorControl2(*pair, controlMode=bullet.TORQUE_CONTROL, force=float(torque), **self.here)
        bullet.stepSimulation(**self.here)
        return self._observed(), 0.0, False, False

    def _observed(self):
        import numpy as np

        bullet, here = self.bullet, self.here
        poses = [sum(bullet.getBasePositionAndOrientation(body, **here), ()) for body in self.bodies]
        joints = [bullet.getJointState(*pair, **here)[:2] for pair in self.joints]
        return {"bodies": np.array(poses), "joints": np.array(joints).reshape(-1, 2)}

    def draw(self):
        """Draw with the TinyRenderer, which needs no OpenGL."""
        import numpy as np

        bullet = self.bullet
        view = bullet.computeViewMatrix([0, -4, 1], [0, 0, 1], [0, 0, 1])
        lens = bullet.computeProjectionMatrixFOV(45, WIDTH / float(HEIGHT), 0.1, 20)
        self.camera_matrices = {"view": list(view), "lens": list(lens)}
        light = {"shadow": 0, "lightAmbientCoeff": 1, "lightDiffuseCoeff": 0, "lightSpecularCoeff": 0}
        width, height, colours, _, _ = bullet.getCameraImage(
            WIDTH, HEIGHT, view, lens, renderer=bullet.ER_TINY_RENDERER, **dict(light, **self.here)
        )
        if not isinstance(colours, np.ndarray):
            self.report("type", "pybullet.no_numpy")
        picture = np.asarray(colours)
        if picture.size != width * height * 4 or not ((picture >= 0) & (picture <= 255)).all():
            violate("pybullet.picture", got=int(picture.size), promised="{} x {}".format(width, height))
        return picture.reshape(height, width, 4)[:, :, :3].astype(np.uint8)

    def get_state(self):
        """Save the state in memory: its number."""
        with library:
            state = self.bullet.saveState(**self.here)
        self.states.append(state)
        return state

    def set_state(self, state):
        """Go back to a saved state."""
        with library:
            self.bullet.restoreState(stateId=state, **self.here)

    def action(self):
        """Draw a torque for each joint."""
        return self.random.uniform(-STRONGEST, STRONGEST, len(self.joints))

    def describe(self):
        """Return the API version, and the numbers of bodies and joints."""
        with library:
            return {"api_version": self.bullet.getAPIVersion(), "bodies": len(self.bodies), "joints": len(self.joints)}

    def close(self):
        """Disconnect."""
        self.bullet.disconnect(**self.here)


def scene(bullet, here):
    """Build a floor, a red box that floats above a blue one, a sphere that falls beside, and an arm with a motor."""
    box(bullet, here, (0.5, 0.05, 0.2), (0, 0.3, 1.8), RED)
    box(bullet, here, (0.5, 0.05, 0.2), (0, 0.3, 0.3), BLUE)
    shape = bullet.createCollisionShape(bullet.GEOM_SPHERE, radius=0.1, **here)
    look = bullet.createVisualShape(bullet.GEOM_SPHERE, radius=0.1, rgbaColor=GREEN, **here)
    sphere = bullet.createMultiBody(1.0, shape, look, [1.0, 0, 1.8], **here)
    return [floor(bullet, here), sphere, arm(bullet, here)]


def floor(bullet, here):
    """Add a large box that does not move."""
    return box(bullet, here, (5, 5, 0.5), (0, 0, -0.5), GREY, solid=True)


def box(bullet, here, half, place, colour, solid=False):
    """Add a box that does not move."""
    look = bullet.createVisualShape(bullet.GEOM_BOX, halfExtents=half, rgbaColor=colour, **here)
    shape = bullet.createCollisionShape(bullet.GEOM_BOX, halfExtents=half, **here) if solid else -1
    return bullet.createMultiBody(0, shape, look, place, **here)


def arm(bullet, here):
    """Add a link that turns about the y axis at a base that stands."""
    half = (0.04, 0.04, 0.25)
    base = bullet.createVisualShape(bullet.GEOM_BOX, halfExtents=[0.03] * 3, rgbaColor=GREY, **here)
    shape = bullet.createCollisionShape(bullet.GEOM_BOX, halfExtents=half, **here)
    look = bullet.createVisualShape(bullet.GEOM_BOX, halfExtents=half, rgbaColor=GREEN, **here)
    return bullet.createMultiBody(
        0,
        -1,
        base,
        [-1.0, 0, 1.2],
        linkMasses=[0.5],
        linkCollisionShapeIndices=[shape],
        linkVisualShapeIndices=[look],
        linkPositions=[[0, 0, 0]],
        linkOrientations=[[0, 0, 0, 1]],
        linkInertialFramePositions=[[0, 0, -0.25]],
        linkInertialFrameOrientations=[[0, 0, 0, 1]],
        linkParentIndices=[0],
        linkJointTypes=[bullet.JOINT_REVOLUTE],
        linkJointAxis=[[0, 1, 0]],
        **here,
    )


def robot(bullet, here, name):
    """Load the bodies of a file."""
    bullet.setAdditionalSearchPath(importlib.import_module("pybullet_data").getDataPath(), **here)
    if name.endswith(".urdf"):
        return [bullet.loadURDF(name, [0, 0, 0.5], **here)]
    return list((bullet.loadMJCF if name.endswith(".xml") else bullet.loadSDF)(name, **here))


API = Bullet()
