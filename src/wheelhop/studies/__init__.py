"""One file a study: what it reports, as data and figures."""
