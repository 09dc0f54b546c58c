"""The database: engine and transactions, tables with named constraints, migrations, task queue."""
