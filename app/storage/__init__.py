"""Where a study is kept: engine and transactions, tables with named constraints, migrations."""
