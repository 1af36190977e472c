-- The plant's store: machines, models, campaigns, checks, events, thinned history.
-- error = actual - indicated; lengths in mm, corrections in mm (rotary: degrees), as in a machine's records.

CREATE TABLE abbe.machines (
    machine integer GENERATED ALWAYS AS IDENTITY PRIMARY KEY,
    site text NOT NULL,
    name text NOT NULL,
    type text NOT NULL,
    structure text NOT NULL DEFAULT '',
    added timestamptz NOT NULL DEFAULT now(),
    -- by the store's clock, when its service last said that it is there
    seen timestamptz,
    status jsonb,
    model text NOT NULL DEFAULT '',
    checks_head text NOT NULL DEFAULT '',
    UNIQUE (site, name)
);

-- Who may see what: readers a site ('*': all), writers a machine.
CREATE TABLE abbe.access (
    role name NOT NULL,
    site text,
    machine integer REFERENCES abbe.machines,
    CHECK ((site IS NULL) <> (machine IS NULL)),
    UNIQUE (role, site),
    UNIQUE (role, machine)
);

CREATE TABLE abbe.models (
    machine integer NOT NULL REFERENCES abbe.machines,
    sha256 text NOT NULL,
    path text NOT NULL,
    fitted timestamptz,
    content bytea NOT NULL,
    stored timestamptz NOT NULL DEFAULT now(),
    PRIMARY KEY (machine, sha256)
);

-- Of files of one path the newest content is the current one.
CREATE TABLE abbe.campaigns (
    machine integer NOT NULL REFERENCES abbe.machines,
    sha256 text NOT NULL,
    path text NOT NULL,
    changed timestamptz NOT NULL,
    current boolean NOT NULL DEFAULT true,
    content bytea NOT NULL,
    stored timestamptz NOT NULL DEFAULT now(),
    PRIMARY KEY (machine, sha256)
);

CREATE TABLE abbe.runs (
    machine integer NOT NULL REFERENCES abbe.machines,
    began timestamptz NOT NULL,
    abbe text NOT NULL,
    configuration text NOT NULL,
    configuration_sha256 text NOT NULL,
    model text NOT NULL,
    model_sha256 text NOT NULL,
    PRIMARY KEY (machine, began, model_sha256, configuration_sha256)
);

-- A reading of a check point, as its row in the machine's file of checks.
CREATE TABLE abbe.checks (
    machine integer NOT NULL REFERENCES abbe.machines,
    key text NOT NULL,
    number integer NOT NULL,
    time timestamptz NOT NULL,
    reading jsonb NOT NULL,
    PRIMARY KEY (machine, key)
);

CREATE TABLE abbe.series (
    machine integer NOT NULL REFERENCES abbe.machines,
    series integer NOT NULL,
    name text NOT NULL,
    unit text NOT NULL,
    PRIMARY KEY (machine, series),
    UNIQUE (machine, name)
);

CREATE TABLE abbe.history (
    time timestamptz NOT NULL,
    least double precision NOT NULL,
    mean double precision NOT NULL,
    greatest double precision NOT NULL,
    machine integer NOT NULL,
    series integer NOT NULL,
    span integer NOT NULL,
    count integer NOT NULL,
    PRIMARY KEY (machine, series, time)
) PARTITION BY RANGE (time);

CREATE TABLE abbe.events (
    time timestamptz NOT NULL,
    event bigint NOT NULL,
    machine integer NOT NULL,
    records text NOT NULL,
    level text NOT NULL,
    part text NOT NULL,
    message text NOT NULL,
    PRIMARY KEY (machine, time, records, event)
) PARTITION BY RANGE (time);

-- What a clock that went wrong has dated to where no month is kept.
CREATE TABLE abbe.history_undated PARTITION OF abbe.history DEFAULT;
CREATE TABLE abbe.events_undated PARTITION OF abbe.events DEFAULT;

-- How far a machine's file of records was uploaded: written with what it says.
CREATE TABLE abbe.uploads (
    machine integer NOT NULL REFERENCES abbe.machines,
    records text NOT NULL,
    event bigint NOT NULL DEFAULT 0,
    event_time double precision NOT NULL DEFAULT 0,
    mark bigint NOT NULL DEFAULT 0,
    at timestamptz NOT NULL DEFAULT now(),
    PRIMARY KEY (machine, records)
);

-- The month of a time, made where there is none; outside of 2015 to next month it stays undated.
CREATE FUNCTION abbe.make_month(at timestamptz) RETURNS void
LANGUAGE plpgsql SECURITY DEFINER SET search_path = pg_catalog AS $$
DECLARE
    month timestamp := date_trunc('month', at AT TIME ZONE 'UTC');
    first timestamptz := month AT TIME ZONE 'UTC';
    after timestamptz := (month + interval '1 month') AT TIME ZONE 'UTC';
    parent text;
    part text;
BEGIN
    IF at < '2015-01-01Z' OR at > now() + interval '1 month' THEN
        RETURN;
    END IF;
    FOREACH parent IN ARRAY ARRAY['history', 'events'] LOOP
        part := parent || to_char(month, '_YYYY_MM');
        IF to_regclass('abbe.' || part) IS NULL THEN
            PERFORM pg_advisory_xact_lock(1633837157, 2);
            IF to_regclass('abbe.' || part) IS NULL THEN
                EXECUTE format('CREATE TABLE abbe.%I (LIKE abbe.%I INCLUDING ALL)', part, parent);
                EXECUTE format(
                    'WITH moved AS (DELETE FROM abbe.%I WHERE time >= %L AND time < %L RETURNING *) '
                    'INSERT INTO abbe.%I SELECT * FROM moved',
                    parent || '_undated', first, after, part);
                EXECUTE format(
                    'ALTER TABLE abbe.%I ATTACH PARTITION abbe.%I FOR VALUES FROM (%L) TO (%L)',
                    parent, part, first, after);
            END IF;
        END IF;
    END LOOP;
END $$;

CREATE FUNCTION abbe.readable() RETURNS SETOF integer
LANGUAGE sql STABLE SECURITY DEFINER SET search_path = pg_catalog AS $$
    SELECT m.machine FROM abbe.machines m JOIN abbe.access a
    ON a.machine = m.machine OR a.site = m.site OR a.site = '*'
    WHERE a.role = session_user
$$;
CREATE FUNCTION abbe.writable() RETURNS SETOF integer
LANGUAGE sql STABLE SECURITY DEFINER SET search_path = pg_catalog AS $$
    SELECT a.machine FROM abbe.access a WHERE a.role = session_user AND a.machine IS NOT NULL
$$;

-- Groups that login roles are members of; roles are of the whole server, so they may be there.
DO $$ BEGIN CREATE ROLE abbe_reader NOLOGIN; EXCEPTION WHEN duplicate_object THEN NULL; END $$;
DO $$ BEGIN CREATE ROLE abbe_writer NOLOGIN; EXCEPTION WHEN duplicate_object THEN NULL; END $$;

REVOKE ALL ON FUNCTION abbe.make_month(timestamptz), abbe.readable(), abbe.writable() FROM PUBLIC;
GRANT USAGE ON SCHEMA abbe TO abbe_reader, abbe_writer;
GRANT SELECT ON abbe.migrations TO abbe_reader, abbe_writer;
GRANT EXECUTE ON FUNCTION abbe.readable() TO abbe_reader, abbe_writer;
GRANT EXECUTE ON FUNCTION abbe.writable(), abbe.make_month(timestamptz) TO abbe_writer;
GRANT SELECT ON abbe.machines, abbe.models, abbe.campaigns, abbe.runs, abbe.checks, abbe.series,
    abbe.history, abbe.events, abbe.uploads TO abbe_reader, abbe_writer;
GRANT UPDATE (structure, seen, status, model, checks_head) ON abbe.machines TO abbe_writer;
GRANT INSERT ON abbe.models, abbe.campaigns, abbe.runs, abbe.checks, abbe.series, abbe.history,
    abbe.events, abbe.uploads TO abbe_writer;
GRANT UPDATE (path, fitted) ON abbe.models TO abbe_writer;
GRANT UPDATE (current, path, changed) ON abbe.campaigns TO abbe_writer;
GRANT UPDATE (unit) ON abbe.series TO abbe_writer;
GRANT UPDATE (least, mean, greatest, span, count) ON abbe.history TO abbe_writer;
GRANT UPDATE (event, event_time, mark, at) ON abbe.uploads TO abbe_writer;

DO $$
DECLARE
    name text;
BEGIN
    FOREACH name IN ARRAY ARRAY['machines', 'models', 'campaigns', 'runs', 'checks', 'series',
                                'history', 'events', 'uploads'] LOOP
        EXECUTE format('ALTER TABLE abbe.%I ENABLE ROW LEVEL SECURITY', name);
        EXECUTE format('CREATE POLICY seen ON abbe.%I FOR SELECT '
                       'USING (machine IN (SELECT abbe.readable()))', name);
        EXECUTE format('CREATE POLICY added ON abbe.%I FOR INSERT '
                       'WITH CHECK (machine IN (SELECT abbe.writable()))', name);
        EXECUTE format('CREATE POLICY changed ON abbe.%I FOR UPDATE '
                       'USING (machine IN (SELECT abbe.writable())) '
                       'WITH CHECK (machine IN (SELECT abbe.writable()))', name);
    END LOOP;
END $$;
