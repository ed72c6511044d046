"""A rendered plan in the formats that others read. Every exporter is a function of the plan and the truth."""
