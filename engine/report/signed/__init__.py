"""The report to sign: a PDF of an output folder, with sheets of its zones, what was left blank, and signatures."""
