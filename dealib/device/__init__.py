"""Devices: regions, ports and supports, shapes that make them, and their meshes in Gmsh."""
