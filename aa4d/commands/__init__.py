"""One module for each command of `aa4d`. What a command needs beyond its arguments is imported when it runs."""
