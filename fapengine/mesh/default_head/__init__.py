"""The default head: a parametric model made by code, with its deformation basis."""
