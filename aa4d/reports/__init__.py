"""Pages and plots of finished work: the demo's report, what effects cost, scenes at a glance."""
