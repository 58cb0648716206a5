"""What dealib's numbers are checked against, one module a subject.

Each module says in its first lines what is computed and where the reference comes from; its
functions give the rows of one table, which `setup/verify` prints and pytest asserts. To add a case,
write a function that yields `Row`s and add one line to `cases.CASES`. Solutions of devices without
finite elements, to compare with, are in `references`.
"""
