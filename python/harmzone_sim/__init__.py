"""Questions to MuJoCo: motion, rays and pictures of one compiled world.

Holds no policy, files, labels or randomness; harmzone embeds this text and calls it in process.
"""

from harmzone_sim.camera import Camera, gl_info
from harmzone_sim.filament import FilamentCamera
from harmzone_sim.rays import cast_rays, visible_geometry
from harmzone_sim.world import World, library_versions

__all__ = [
    "Camera",
    "FilamentCamera",
    "World",
    "cast_rays",
    "gl_info",
    "library_versions",
    "visible_geometry",
]
