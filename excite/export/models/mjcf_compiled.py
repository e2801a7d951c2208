"""MJCF texts through MuJoCo's compiler; loads little, since a child process does it for other people's."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from excite.errors import InputError
from excite.formats.child import in_child

if TYPE_CHECKING:
    import mujoco


def compile_mjcf(content: bytes, template: Path | None) -> mujoco.MjModel:
    """Compile a text as if it stood where ``template`` stands: somebody else's, in a process of its own."""
    # The child process starts in a third of the time without what reading descriptions needs.
    from excite.robot.mjcf.conversion import COMPILE_MEMORY_GB, COMPILE_SECONDS  # lazy: pinocchio

    if template is None:
        return compile_text(content, None)
    folder = template.resolve().parent
    return in_child(
        "excite.export.models.mjcf_compiled:compile_text",
        content,
        folder,
        template,
        source=template,
        seconds=COMPILE_SECONDS,
        memory_gb=COMPILE_MEMORY_GB,
    )


def compile_text(content: bytes, folder: Path | None, source: object = "written model") -> mujoco.MjModel:
    """Compile a text in this process; paths in it are relative to ``folder``."""
    import mujoco

    try:
        spec = mujoco.MjSpec.from_string(content.decode("utf-8"))
        if folder is not None:
            # MuJoCo writes warnings to a file in the current folder.
            mujoco.set_mju_user_warning(lambda _: None)
            # Make paths absolute, and leave out shapes whose files are not there: inertials are what counts here.
            meshes = folder / spec.meshdir
            spec.meshdir, spec.texturedir = str(meshes), str(folder / spec.texturedir)
            missing = {mesh.name for mesh in spec.meshes if mesh.file and not (meshes / mesh.file).is_file()}
            for geom in [geom for geom in spec.geoms if geom.meshname in missing]:
                spec.delete(geom)
            for mesh in [mesh for mesh in spec.meshes if mesh.name in missing]:
                spec.delete(mesh)
        return spec.compile()
    except (ValueError, OSError, RuntimeError) as error:
        raise InputError(
            f"MuJoCo refuses it ({' '.join(str(error).split())})",
            source=source,
            remedy="check that it loads in MuJoCo's viewer, with its meshes beside it",
        ) from error
