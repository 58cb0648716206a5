"""Pages in the browser: a config under sliders, and the results of a run."""
