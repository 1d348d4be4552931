"""Keep a cart on a rail with a pole on it, as OpenUSD, for Isaac Lab: its own robots are files on NVIDIA's servers."""

import os

REMOTE = "/Robots/Classic/Cartpole/cartpole.usd"
"""The end of the address of the file that this one replaces."""

BODY = """
    def Xform "{name}" (
        prepend apiSchemas = ["PhysicsRigidBodyAPI", "PhysicsMassAPI"]
    )
    {{
        float physics:mass = {mass}
        float3 physics:diagonalInertia = (0.05, 0.05, 0.05)
{place}
        def Cube "shape"
        {{
            double size = 1
            float3 xformOp:scale = {scale}
            uniform token[] xformOpOrder = ["xformOp:scale"]
        }}
    }}
"""
RAISED = """        double3 xformOp:translate = (0, 0, 0.5)
        uniform token[] xformOpOrder = ["xformOp:translate"]
"""
USD = (
    """#usda 1.0
(
    defaultPrim = "cartpole"
    metersPerUnit = 1
    upAxis = "Z"
)

def Xform "cartpole" (
    prepend apiSchemas = ["PhysicsArticulationRootAPI"]
)
{"""
    + BODY.format(name="rail", mass=1, place="", scale=(0.05, 8, 0.05))
    + BODY.format(name="cart", mass=1, place="", scale=(0.2, 0.25, 0.2))
    + BODY.format(name="pole", mass=0.2, place=RAISED, scale=(0.06, 0.06, 1))
    + """
    def PhysicsFixedJoint "root_joint"
    {
        rel physics:body1 = </cartpole/rail>
    }

    def PhysicsPrismaticJoint "slider_to_cart" (
        prepend apiSchemas = ["PhysicsDriveAPI:linear"]
    )
    {
        rel physics:body0 = </cartpole/rail>
        rel physics:body1 = </cartpole/cart>
        uniform token physics:axis = "Y"
        float physics:lowerLimit = -4
        float physics:upperLimit = 4
        uniform token drive:linear:physics:type = "force"
        float drive:linear:physics:stiffness = 0
        float drive:linear:physics:damping = 0
    }

    def PhysicsRevoluteJoint "cart_to_pole" (
        prepend apiSchemas = ["PhysicsDriveAPI:angular"]
    )
    {
        rel physics:body0 = </cartpole/cart>
        rel physics:body1 = </cartpole/pole>
        point3f physics:localPos1 = (0, 0, -0.5)
        uniform token physics:axis = "X"
        uniform token drive:angular:physics:type = "force"
        float drive:angular:physics:stiffness = 0
        float drive:angular:physics:damping = 0
    }
}
"""
)
"""Lengths in metres, masses in kilograms; the joints are named as Isaac Lab's tasks name them."""


def use_local_cartpole(spawn, folder):
    """Replace NVIDIA's cart and pole in a spawner by this one, written into a folder; leave other robots unchanged."""
    if not str(getattr(spawn, "usd_path", "")).endswith(REMOTE):
        return
    path = os.path.join(folder, "cartpole.usda")
    with open(path, "w", encoding="utf-8") as file:
        file.write(USD)
    spawn.usd_path = path
