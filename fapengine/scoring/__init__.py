"""How good is a lip sync? Measures of one recorded face against another, against phones, and against its sound."""
