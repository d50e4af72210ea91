"""Reconstruction of the wall: maps, fusion, meshes and findings."""
