"""Slope scenes of one epoch whose every point has a known label: what the screening network learns from and is scored
on.

A scene is a height field over the slope's mean plane (``surface``, ``terrain``), structures and landforms that look
like hazards but are none (``structures``, ``landforms``), hazards of known displacement (``hazards``, ``placing``), a
scan of it (``scan``) and what ground filtering leaves behind (``residue``). ``scenes.scene`` puts them together,
``sets`` names the benchmark sets, ``picture`` draws a scene.
"""
