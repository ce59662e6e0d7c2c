"""How long tests wait, generous enough for a machine that does much else: only what fails takes as long."""

# Until something that must happen has happened: a program is at work, a process has ended.
PATIENCE_S = 120.0
# What a cancelled run may take. The contract is two seconds; it is held where no other work runs (test_cancellation.py
# and test_engine_client.py), and this limit where programs with much to load or to end take part.
CANCELLED_S = 20.0
