"""Device shapes as Gmsh models, their names and their supports."""
