"""Error and compensation tables: what a controller can hold of a model, and what remains.

================ =====================================================================
``table``         one table: nodes, values, its sign; read as a controller reads it
``field``         the model's error at stated temperatures and tool, where tables look it up
``volume``        the working volume over which a table is to be the best
``grid``          spatial grids, straight from the model
``capability``    what a controller can hold, as data
``marginal``      the part of a field that depends on one axis (least squares over the volume)
``single_axes``   what tables over single axes are to hold
``products``      the parts that grow evenly with another axis's position (levers)
``choice``        which tables, where a controller has fewer than would be of use
``motions``       the six error motions of each axis, for controllers that know levers
``nodes``         where the points of a table stand best
``hats``          values at given points, by least squares
``quantise``      values in whole steps, without bias
``project``       all of these: the best tables that a controller can hold
``remainder``     what is left of the error with a set of tables
``form``          reversal as a column, a difference or a single value; increments
``table_set``     tables, files and their record (ISO/TR 16907, 9.1) as one thing
================ =====================================================================
"""

from abbe.compcore.tables.table import Sign, Table, move, tables_of

__all__ = ["Sign", "Table", "move", "tables_of"]
