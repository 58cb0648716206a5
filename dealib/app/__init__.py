"""Pages in the browser: a config with sliders, and the results of a run."""
