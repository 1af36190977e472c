"""Other measuring systems' files to campaigns; each says the sign it assumed.

==============  ==================================================================
`iso230_table`  tables of runs and directions as ISO 230-2 prints them (CSV)
`rtl`           Renishaw laser measurements (``.rtl``, ``.rta``)
`ballbar`       circular tests with a ball bar (CSV)
`log`           a logger's table: thermometers and indicators, a row a moment (CSV)
`tpoint`        stars that a telescope pointed at, as TPOINT reads them
`map_rows`      a compensation map, as the measurements it would have come from
==============  ==================================================================
"""
