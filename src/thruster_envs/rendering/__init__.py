"""Pictures of an episode: the craft with its plumes, its path, and what was commanded and delivered.

Public names: :class:`Scene`, :class:`CraftScene` and :class:`Curve` (what to draw), :class:`Renderer` (draws
it). Importing this package does not import pygame; making a ``Renderer`` does.
"""

from thruster_envs.rendering.renderer import Renderer
from thruster_envs.rendering.scene import CraftScene, Curve, Scene

__all__ = ["CraftScene", "Curve", "Renderer", "Scene"]
