"""From echoes to a 3-D finding: time of flight, depth of pits, the wall laid flat, meshes."""
