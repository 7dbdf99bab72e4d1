"""Characters that Drapery skins itself stand where Pixar's own skinning puts them.

The characters are built here with Pixar's library: joints in other orders than the skeleton's, bind poses with rotations and
scales, animations that move only some joints, sparse blend shapes with shapes in between, turned and mirrored parents.
`DRAPERY_USD_POINTS` names the program that `io/usd/examples/usd_points.rs` describes; `make test` sets it.
"""

import json
import os
import subprocess

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, UsdSkel, Vt

from judges import ROOT, SHARED

JOINTS = ["hip", "hip/spine", "hip/spine/head", "hip/leg"]
CODES = [1.0, 5.0, 12.0]


def ours(path, prim, codes):
    program = os.environ.get("DRAPERY_USD_POINTS", str(ROOT / "target/release/examples/usd_points"))
    command = [program, str(path), prim, *[str(code) for code in codes]]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def matrix(random, scales=True, mirror=False):
    turn = Gf.Rotation(Gf.Vec3d(*random.normal(size=3)), random.uniform(0, 360))
    size = Gf.Vec3d(*random.uniform(0.5, 1.5, size=3)) if scales else Gf.Vec3d(1)
    size = Gf.Vec3d(-size[0], size[1], size[2]) if mirror else size
    move = Gf.Vec3d(*random.uniform(-1, 1, size=3))
    return Gf.Matrix4d().SetScale(size) * Gf.Matrix4d().SetRotate(turn) * Gf.Matrix4d().SetTranslate(move)


def animate(stage, random, joints, shapes, scales_move):
    animation = UsdSkel.Animation.Define(stage, "/character/animation")
    animation.CreateJointsAttr(joints)
    moves, turns, scales = (
        animation.CreateTranslationsAttr(),
        animation.CreateRotationsAttr(),
        animation.CreateScalesAttr(),
    )
    # Half precision has these exactly, at any share of two samples.
    still = random.choice([0.5, 1.0, 2.0], size=(len(joints), 3))
    for code in CODES:
        moves.Set(Vt.Vec3fArray([Gf.Vec3f(*random.uniform(-1, 1, size=3)) for _ in joints]), code)
        quaternions = [Gf.Quatf(*q) for q in random.normal(size=(len(joints), 4))]
        turns.Set(Vt.QuatfArray([q.GetNormalized() for q in quaternions]), code)
        sizes = random.uniform(0.5, 1.5, size=still.shape) if scales_move else still
        scales.Set(Vt.Vec3hArray([Gf.Vec3h(*size) for size in sizes]), code)
    if shapes:
        animation.CreateBlendShapesAttr(shapes)
        weights = animation.CreateBlendShapeWeightsAttr()
        for code in CODES:
            weights.Set(Vt.FloatArray([float(w) for w in random.uniform(-0.4, 1.6, size=len(shapes))]), code)
    return animation


def blend_shapes(stage, random, binding, count):
    targets = []
    for name, sparse in [("smile", False), ("frown", True)]:
        shape = UsdSkel.BlendShape.Define(stage, f"/character/mesh/{name}")
        moved = sorted(random.choice(count, size=count // 3, replace=False)) if sparse else range(count)
        offsets = lambda: Vt.Vec3fArray([Gf.Vec3f(*random.normal(scale=0.2, size=3)) for _ in moved])
        shape.CreateOffsetsAttr(offsets())
        if sparse:
            shape.CreatePointIndicesAttr(Vt.IntArray([int(i) for i in moved]))
        for weight in (0.3, 0.7) if sparse else ():
            between = shape.CreateInbetween(f"at{int(10 * weight)}")
            between.SetWeight(weight)
            between.SetOffsets(offsets())
        targets.append(shape.GetPath())
    binding.CreateBlendShapesAttr(["smile", "frown"])
    binding.CreateBlendShapeTargetsRel().SetTargets(targets)


def character(path, seed, method="classicLinear", rigid=False, shapes=False, sums=1.0, mirror=False, partial=False, scales_move=False):
    random = np.random.default_rng(seed)
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    stage.SetTimeCodesPerSecond(24)
    above = UsdGeom.Xform.Define(stage, "/character")
    stage.GetPrimAtPath("/character").SetTypeName("SkelRoot")
    turn = UsdGeom.Xformable(above).AddRotateXYZOp()
    for code in CODES:
        turn.Set(Gf.Vec3f(*random.uniform(-90, 90, size=3)), code)
    if mirror:
        UsdGeom.Xformable(above).AddScaleOp().Set(Gf.Vec3f(-1, 2, 1))
    skeleton = UsdSkel.Skeleton.Define(stage, "/character/skeleton")
    UsdGeom.Xformable(skeleton).AddTranslateOp().Set(Gf.Vec3d(0.1, 0.2, 0.3))
    skeleton.CreateJointsAttr(JOINTS)
    skeleton.CreateBindTransformsAttr(Vt.Matrix4dArray([matrix(random) for _ in JOINTS]))
    skeleton.CreateRestTransformsAttr(Vt.Matrix4dArray([matrix(random) for _ in JOINTS]))
    moved = ["hip/leg", "hip/spine"] if partial else list(reversed(JOINTS))
    animation = animate(stage, random, moved, ["frown", "other", "smile"] if shapes else [], scales_move)
    UsdSkel.BindingAPI.Apply(skeleton.GetPrim()).CreateAnimationSourceRel().SetTargets([animation.GetPath()])
    mesh = UsdGeom.Mesh.Define(stage, "/character/mesh")
    UsdGeom.Xformable(mesh).AddTransformOp().Set(matrix(random))
    count = 40
    mesh.CreatePointsAttr(Vt.Vec3fArray([Gf.Vec3f(*p) for p in random.uniform(-1, 1, size=(count, 3))]))
    mesh.CreateFaceVertexCountsAttr([3, 4])
    mesh.CreateFaceVertexIndicesAttr([0, 1, 2, 3, 4, 5, 6])
    binding = UsdSkel.BindingAPI.Apply(mesh.GetPrim())
    binding.CreateSkeletonRel().SetTargets([skeleton.GetPath()])
    binding.CreateGeomBindTransformAttr(matrix(random))
    binding.CreateJointsAttr(["hip/spine/head", "hip", "hip/leg", "hip/spine"])
    places = 3 if not rigid else 2
    rows = 1 if rigid else count
    weights = random.uniform(0.01, 1, size=(rows, places))
    weights *= sums / weights.sum(axis=1, keepdims=True)
    binding.CreateJointIndicesPrimvar(rigid, places).Set(Vt.IntArray([int(i) for i in random.integers(4, size=rows * places)]))
    binding.CreateJointWeightsPrimvar(rigid, places).Set(Vt.FloatArray([float(w) for w in weights.flatten()]))
    binding.CreateSkinningMethodAttr(method)
    if shapes:
        blend_shapes(stage, random, binding, count)
    stage.Save()
    return stage


def baked(path, prim, codes):
    """World positions after Pixar's library has baked the skinning into the points."""
    stage = Usd.Stage.Open(str(path))
    for root in [prim for prim in stage.Traverse() if prim.IsA(UsdSkel.Root)]:
        assert UsdSkel.BakeSkinning(UsdSkel.Root(root), Gf.Interval(min(codes), max(codes)))
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath(prim))
    found = []
    for code in codes:
        world = np.array(mesh.ComputeLocalToWorldTransform(code))
        points = np.array(mesh.GetPointsAttr().Get(code), dtype=float)
        found.append(points @ world[:3, :3] + world[3, :3])
    return found


def queried(path, prim, codes):
    """World positions by Pixar's skinning query, which knows every time code."""
    stage = Usd.Stage.Open(str(path))
    root = UsdSkel.Root(next(prim for prim in stage.Traverse() if prim.IsA(UsdSkel.Root)))
    cache = UsdSkel.Cache()
    cache.Populate(root, Usd.PrimDefaultPredicate)
    binding = cache.ComputeSkelBindings(root, Usd.PrimDefaultPredicate)[0]
    skeleton = cache.GetSkelQuery(binding.GetSkeleton())
    skinning = next(target for target in binding.GetSkinningTargets() if str(target.GetPrim().GetPath()) == prim)
    found = []
    for code in codes:
        points = UsdGeom.Mesh(skinning.GetPrim()).GetPointsAttr().Get(code)
        if skinning.HasBlendShapes():
            shapes = UsdSkel.BlendShapeQuery(UsdSkel.BindingAPI(skinning.GetPrim()))
            weights = skinning.GetBlendShapeMapper().Remap(skeleton.GetAnimQuery().ComputeBlendShapeWeights(code))
            parts = shapes.ComputeSubShapeWeights(weights)
            assert shapes.ComputeDeformedPoints(*parts, shapes.ComputeBlendShapePointIndices(), shapes.ComputeSubShapePointOffsets(), points)
        assert skinning.ComputeSkinnedPoints(skeleton.ComputeSkinningTransforms(code), points, code)
        world = np.array(UsdGeom.Xformable(skeleton.GetPrim()).ComputeLocalToWorldTransform(code))
        found.append(np.array(points, dtype=float) @ world[:3, :3] + world[3, :3])
    return found


CHARACTERS = {
    "linear": {},
    "dual quaternions": {"method": "dualQuaternion"},
    "rigid": {"rigid": True},
    "rigid, dual quaternions": {"rigid": True, "method": "dualQuaternion"},
    "blend shapes": {"shapes": True},
    "weights that do not sum to one": {"sums": 0.8},
    "mirrored parent": {"mirror": True},
    "animation of some joints": {"partial": True, "shapes": True},
    "scales that move": {"scales_move": True},
}


@pytest.mark.parametrize("kind", CHARACTERS)
@pytest.mark.parametrize("ending", ["usda", "usdc"])
def test_characters_stand_where_pixars_skinning_puts_them(tmp_path, kind, ending, report_figure):
    path = tmp_path / f"character.{ending}"
    character(path, seed=7 * len(kind), **CHARACTERS[kind])
    between = [*CODES, 0.0, 3.3, 8.75, 20.0]
    told = ours(path, "/character/mesh", between)
    assert told["codes"] == CODES
    assert any("do not sum to one" in note for note in told["notes"]) == (kind == "weights that do not sum to one")
    points = [np.array(points) for points in told["points"]]
    size = max(np.abs(p).max() for p in points)
    by_query = max(np.abs(a - b).max() for a, b in zip(points, queried(path, "/character/mesh", between))) / size
    by_bake = max(np.abs(a - b).max() for a, b in zip(points, baked(path, "/character/mesh", CODES))) / size
    # Pixar's library computes in single precision; between samples it interpolates scales in half precision.
    allowed = 1e-3 if kind == "scales that move" else 2e-6
    assert by_bake < 2e-6 and by_query < allowed, f"query {by_query:.1e}, bake {by_bake:.1e} of {size:.1f}"
    report_figure(f"{kind}, .{ending}: {max(by_query, by_bake):.1e} of the character's size from Pixar's skinning")


def test_a_package_of_another_program_stands_where_pixars_skinning_puts_it():
    path = SHARED / "foreign_caches/usd/usdwg_RiggedFigure.usdz"
    prim = "/RiggedFigure/Geom/Z_UP/Armature/torso_joint_1_2/Proxy_1"
    codes = [0.0, 4.5, 12.0, 30.0]
    points = ours(path, prim, codes)["points"]
    for ours_at, theirs in zip(points, queried(path, prim, codes)):
        assert np.abs(np.array(ours_at) - theirs).max() < 2e-6
