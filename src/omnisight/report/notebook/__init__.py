"""HTML of results for notebooks: one file per type, which has its name and a function `html`."""
