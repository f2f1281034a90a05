"""A posterior over sets of terms in one linear Gaussian model: what a search for missing physics weighs and draws."""
