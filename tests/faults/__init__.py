"""Full disks, folders that cannot be written and killed processes, for every command that writes: `make faults`."""
