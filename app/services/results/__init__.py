"""What came out across a study's sessions, and what was learnt in one: tidy tables and sentences.

`tables` and `story` read the tables, `drawing` makes charts of them with app.figures.
"""
