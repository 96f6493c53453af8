"""Quality of a lip sync: measures of one recorded face against another, against phones, and against its sound."""
