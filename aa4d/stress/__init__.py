"""Hard cases as a table that runs, and the search for more of them: `aa4d stress`."""
