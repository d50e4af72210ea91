"""The wall as it was found: maps, fusion, meshes and findings."""
