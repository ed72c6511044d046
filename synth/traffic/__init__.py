"""Who drives where and when: lanes, car following, a signal, parked vehicles. Plain numpy, float64, no randomness
but what a seeded generator hands in."""
