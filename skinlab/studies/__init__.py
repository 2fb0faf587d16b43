"""Many curves of many people: one table, and what it says about device, people and change."""
