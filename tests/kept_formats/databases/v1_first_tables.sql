BEGIN TRANSACTION;
CREATE TABLE alembic_version (
	version_num VARCHAR(32) NOT NULL, 
	CONSTRAINT alembic_version_pkc PRIMARY KEY (version_num)
);
INSERT INTO "alembic_version" VALUES('1');
CREATE TABLE audit (
	id INTEGER NOT NULL, 
	at_us BIGINT NOT NULL, 
	actor VARCHAR(80) NOT NULL, 
	action VARCHAR(40) NOT NULL, 
	data JSON NOT NULL, 
	hash VARCHAR(64) NOT NULL, 
	PRIMARY KEY (id), 
	UNIQUE (hash)
);
INSERT INTO "audit" VALUES(1,1728043200000000,'admin','phase-set','{"id": "dev", "title": "Development", "suite": "interdrive", "public": true, "opens_us": 0, "closes_us": 2592000000000000, "per_day": 3, "in_parallel": 2, "in_total": 100, "seeds": 1, "sensor_track_only": false, "cross_play_scenarios": 0}','29d7efdc1dfbfdc25015ca02244a8c74a07a2ea9c95ab8a7173a92f8ac3ad8c9');
INSERT INTO "audit" VALUES(2,1728043200000000,'admin','team-created','{"team": "2c6c4310c2f481506da7ec358a8abf7e", "name": "Kept"}','654b38a75df56788f23028ffd31f2446632b944b61e2b6a92ad0dc77bd7949f2');
INSERT INTO "audit" VALUES(3,1728043200000000,'team:2c6c4310c2f481506da7ec358a8abf7e','submission-accepted','{"submission": "03881cd512b9f366fe49cf275c7546c2", "phase": "dev", "track": "single-agent", "name": "method", "archive_sha256": "56662033f7242152a127777d911cbf31b4e883a41f8c6a161a2646471d5d29eb", "environment": "python3.11-numpy", "evaluator": {"version": "1"}, "counts": true, "jobs_sha256": "cf46bbbeb813e9d94ccab178adad3906188a3c31862e685441811672f00d0abf"}','0709edd006b58e68abe077884c653287b9f8bcd6506131af4afdca58bc3a02d3');
INSERT INTO "audit" VALUES(4,1728043202000000,'server','submission-done','{"submission": "03881cd512b9f366fe49cf275c7546c2", "phase": "dev", "track": "single-agent", "name": "method", "archive_sha256": "56662033f7242152a127777d911cbf31b4e883a41f8c6a161a2646471d5d29eb", "environment": "python3.11-numpy", "evaluator": {"version": "1"}, "counts": true, "ds": 80.0, "summary_sha256": "a2fcce6e389967dd69395f7a5c415f3bb01e18526b2b41f46e30d01b14e9f503"}','2bc0fa89a08129c292f78fb9791f91467e6876ffa3502c50dbc2dd350d2213ed');
CREATE TABLE events (
	id INTEGER NOT NULL, 
	submission VARCHAR(32) NOT NULL, 
	at_us BIGINT NOT NULL, 
	kind VARCHAR(24) NOT NULL, 
	data JSON NOT NULL, 
	PRIMARY KEY (id), 
	FOREIGN KEY(submission) REFERENCES submissions (id)
);
INSERT INTO "events" VALUES(1,'03881cd512b9f366fe49cf275c7546c2',1728043200000000,'state','{"state": "queued"}');
INSERT INTO "events" VALUES(2,'03881cd512b9f366fe49cf275c7546c2',1728043201000000,'state','{"state": "running"}');
INSERT INTO "events" VALUES(3,'03881cd512b9f366fe49cf275c7546c2',1728043201000000,'started','{"scenario": "left-turn", "seed": 0, "attempt": 1}');
INSERT INTO "events" VALUES(4,'03881cd512b9f366fe49cf275c7546c2',1728043202000000,'scenario','{"scenario": "left-turn", "seed": 0, "verdict": "ok", "reason": null, "ds": 80.0, "sr": 100.0}');
INSERT INTO "events" VALUES(5,'03881cd512b9f366fe49cf275c7546c2',1728043201000000,'started','{"scenario": "merge", "seed": 0, "attempt": 1}');
INSERT INTO "events" VALUES(6,'03881cd512b9f366fe49cf275c7546c2',1728043202000000,'scenario','{"scenario": "merge", "seed": 0, "verdict": "ok", "reason": null, "ds": 80.0, "sr": 100.0}');
INSERT INTO "events" VALUES(7,'03881cd512b9f366fe49cf275c7546c2',1728043202000000,'state','{"state": "done"}');
CREATE TABLE job_overviews (
	job INTEGER NOT NULL, 
	submission VARCHAR(32) NOT NULL, 
	data JSON NOT NULL, 
	PRIMARY KEY (job), 
	FOREIGN KEY(job) REFERENCES jobs (id), 
	FOREIGN KEY(submission) REFERENCES submissions (id)
);
INSERT INTO "job_overviews" VALUES(1,'03881cd512b9f366fe49cf275c7546c2','{"bucket": null, "category": null, "ds": 80.0, "sr": 100.0, "efficient_sr": null, "time_ratio": null, "rc": null, "ip": null, "egos": null, "usage": null}');
INSERT INTO "job_overviews" VALUES(2,'03881cd512b9f366fe49cf275c7546c2','{"bucket": null, "category": null, "ds": 80.0, "sr": 100.0, "efficient_sr": null, "time_ratio": null, "rc": null, "ip": null, "egos": null, "usage": null}');
CREATE TABLE jobs (
	id INTEGER NOT NULL, 
	kind VARCHAR(16) NOT NULL, 
	submission VARCHAR(32) NOT NULL, 
	others VARCHAR(32) NOT NULL, 
	evaluator VARCHAR(16) NOT NULL, 
	scenario VARCHAR(120) NOT NULL, 
	seed BIGINT NOT NULL, 
	state VARCHAR(16) NOT NULL, 
	attempt BIGINT NOT NULL, 
	failures BIGINT NOT NULL, 
	owner VARCHAR(80), 
	lease_us BIGINT, 
	started_us BIGINT, 
	finished_us BIGINT, 
	verdict VARCHAR(16), 
	reason VARCHAR(16), 
	result JSON, 
	usage JSON, 
	failure TEXT NOT NULL, 
	PRIMARY KEY (id), 
	UNIQUE (kind, submission, others, evaluator, scenario, seed), 
	FOREIGN KEY(submission) REFERENCES submissions (id), 
	FOREIGN KEY(others) REFERENCES submissions (id)
);
INSERT INTO "jobs" VALUES(1,'submission','03881cd512b9f366fe49cf275c7546c2','03881cd512b9f366fe49cf275c7546c2','','left-turn',0,'done',1,0,'worker',NULL,1728043201000000,1728043202000000,'ok',NULL,'{"ds": 80.0, "sr": 100.0}',NULL,'');
INSERT INTO "jobs" VALUES(2,'submission','03881cd512b9f366fe49cf275c7546c2','03881cd512b9f366fe49cf275c7546c2','','merge',0,'done',1,0,'worker',NULL,1728043201000000,1728043202000000,'ok',NULL,'{"ds": 80.0, "sr": 100.0}',NULL,'');
CREATE TABLE phases (
	id VARCHAR(40) NOT NULL, 
	title VARCHAR(120) NOT NULL, 
	suite TEXT NOT NULL, 
	public BOOLEAN NOT NULL, 
	opens_us BIGINT NOT NULL, 
	closes_us BIGINT NOT NULL, 
	per_day BIGINT NOT NULL, 
	in_parallel BIGINT NOT NULL, 
	in_total BIGINT NOT NULL, 
	seeds BIGINT NOT NULL, 
	sensor_track_only BOOLEAN NOT NULL, 
	cross_play_scenarios BIGINT NOT NULL, 
	PRIMARY KEY (id)
);
INSERT INTO "phases" VALUES('dev','Development','interdrive',1,0,2592000000000000,3,2,100,1,0,0);
CREATE TABLE refused_uploads (
	id INTEGER NOT NULL, 
	team VARCHAR(32) NOT NULL, 
	at_us BIGINT NOT NULL, 
	PRIMARY KEY (id), 
	FOREIGN KEY(team) REFERENCES teams (id)
);
CREATE TABLE standings (
	phase VARCHAR(40) NOT NULL, 
	slice VARCHAR(80) NOT NULL, 
	track VARCHAR(24) NOT NULL, 
	sensing_track VARCHAR(8) NOT NULL, 
	team VARCHAR(32) NOT NULL, 
	evaluator VARCHAR(16) NOT NULL, 
	submission VARCHAR(32) NOT NULL, 
	method VARCHAR(80) NOT NULL, 
	created_us BIGINT NOT NULL, 
	ds DOUBLE NOT NULL, 
	figures JSON NOT NULL, 
	PRIMARY KEY (phase, slice, track, sensing_track, team, evaluator), 
	FOREIGN KEY(phase) REFERENCES phases (id), 
	FOREIGN KEY(team) REFERENCES teams (id), 
	FOREIGN KEY(submission) REFERENCES submissions (id)
)
 WITHOUT ROWID

;
INSERT INTO "standings" VALUES('dev','bucket:interaction','single-agent','object','2c6c4310c2f481506da7ec358a8abf7e','f76983c7e4744f0b','03881cd512b9f366fe49cf275c7546c2','method',1728043200000000,20.0,'{"ds": 20.0}');
INSERT INTO "standings" VALUES('dev','bucket:interdrive','single-agent','object','2c6c4310c2f481506da7ec358a8abf7e','f76983c7e4744f0b','03881cd512b9f366fe49cf275c7546c2','method',1728043200000000,80.0,'{"ds": 80.0}');
INSERT INTO "standings" VALUES('dev','category:merge','single-agent','object','2c6c4310c2f481506da7ec358a8abf7e','f76983c7e4744f0b','03881cd512b9f366fe49cf275c7546c2','method',1728043200000000,80.0,'{"ds": 80.0}');
INSERT INTO "standings" VALUES('dev','overall','single-agent','object','2c6c4310c2f481506da7ec358a8abf7e','f76983c7e4744f0b','03881cd512b9f366fe49cf275c7546c2','method',1728043200000000,80.0,'{"ds": 80.0, "sr": 50.0}');
CREATE TABLE submissions (
	id VARCHAR(32) NOT NULL, 
	team VARCHAR(32) NOT NULL, 
	phase VARCHAR(40) NOT NULL, 
	track VARCHAR(24) NOT NULL, 
	name VARCHAR(80) NOT NULL, 
	archive_sha256 VARCHAR(64) NOT NULL, 
	archive_bytes BIGINT NOT NULL, 
	environment VARCHAR(40) NOT NULL, 
	idempotency_key VARCHAR(80), 
	state VARCHAR(16) NOT NULL, 
	why TEXT NOT NULL, 
	created_us BIGINT NOT NULL, 
	finished_us BIGINT, 
	counts BOOLEAN NOT NULL, 
	shown BOOLEAN NOT NULL, 
	evaluator JSON NOT NULL, 
	summary JSON, 
	ds DOUBLE, 
	spent_us BIGINT NOT NULL, 
	PRIMARY KEY (id), 
	UNIQUE (team, idempotency_key), 
	FOREIGN KEY(team) REFERENCES teams (id), 
	FOREIGN KEY(phase) REFERENCES phases (id)
);
INSERT INTO "submissions" VALUES('03881cd512b9f366fe49cf275c7546c2','2c6c4310c2f481506da7ec358a8abf7e','dev','single-agent','method','56662033f7242152a127777d911cbf31b4e883a41f8c6a161a2646471d5d29eb',273,'python3.11-numpy',NULL,'done','',1728043200000000,1728043202000000,1,1,'{"version": "1"}','{"overall": {"ds": 80.0, "sr": 50.0}, "buckets": {"interdrive": {"ds": 80.0}, "interaction": {"ds": 20.0}}, "categories": {"merge": {"ds": 80.0}}, "sensing_track": "object", "results_sha256": "2953f1ccc4de33dcd1cb751a55fe38f02fabdfb4e8e854d2d776ebfeda41472c"}',80.0,2000000);
CREATE TABLE teams (
	id VARCHAR(32) NOT NULL, 
	name VARCHAR(64) NOT NULL, 
	created_us BIGINT NOT NULL, 
	hidden BOOLEAN NOT NULL, 
	PRIMARY KEY (id), 
	UNIQUE (name)
);
INSERT INTO "teams" VALUES('2c6c4310c2f481506da7ec358a8abf7e','Kept',1728043200000000,0);
CREATE TABLE tokens (
	id VARCHAR(32) NOT NULL, 
	team VARCHAR(32), 
	hash VARCHAR(64) NOT NULL, 
	scope VARCHAR(16) NOT NULL, 
	created_us BIGINT NOT NULL, 
	revoked_us BIGINT, 
	PRIMARY KEY (id), 
	FOREIGN KEY(team) REFERENCES teams (id), 
	UNIQUE (hash)
);
CREATE TABLE webhook_deliveries (
	id VARCHAR(32) NOT NULL, 
	submission VARCHAR(32) NOT NULL, 
	team VARCHAR(32) NOT NULL, 
	state VARCHAR(16) NOT NULL, 
	attempts BIGINT NOT NULL, 
	next_us BIGINT NOT NULL, 
	created_us BIGINT NOT NULL, 
	problem TEXT NOT NULL, 
	PRIMARY KEY (id), 
	FOREIGN KEY(submission) REFERENCES submissions (id), 
	FOREIGN KEY(team) REFERENCES teams (id)
);
CREATE TABLE webhooks (
	team VARCHAR(32) NOT NULL, 
	url TEXT NOT NULL, 
	secret VARCHAR(64) NOT NULL, 
	created_us BIGINT NOT NULL, 
	PRIMARY KEY (team), 
	FOREIGN KEY(team) REFERENCES teams (id)
);
CREATE TABLE worker_time (
	team VARCHAR(32) NOT NULL, 
	phase VARCHAR(40) NOT NULL, 
	used_us BIGINT NOT NULL, 
	at_us BIGINT NOT NULL, 
	PRIMARY KEY (team, phase), 
	FOREIGN KEY(team) REFERENCES teams (id), 
	FOREIGN KEY(phase) REFERENCES phases (id)
);
INSERT INTO "worker_time" VALUES('2c6c4310c2f481506da7ec358a8abf7e','dev',2000000,1728043202000000);
CREATE TABLE workers (
	owner VARCHAR(80) NOT NULL, 
	host VARCHAR(80) NOT NULL, 
	version VARCHAR(40) NOT NULL, 
	scheduler VARCHAR(120) NOT NULL, 
	started_us BIGINT NOT NULL, 
	seen_us BIGINT NOT NULL, 
	PRIMARY KEY (owner)
);
CREATE INDEX refused_uploads_of_team ON refused_uploads (team, at_us);
CREATE INDEX submissions_by_state ON submissions (state);
CREATE INDEX submissions_of_team ON submissions (team, phase, created_us, id, state, shown, ds, track);
CREATE INDEX events_of_submission ON events (submission, id);
CREATE INDEX jobs_of_submission ON jobs (submission, kind, state);
CREATE INDEX jobs_to_claim ON jobs (state, lease_us);
CREATE INDEX webhook_deliveries_due ON webhook_deliveries (state, next_us);
CREATE INDEX webhook_deliveries_of_team ON webhook_deliveries (team, created_us);
CREATE INDEX job_overviews_of_submission ON job_overviews (submission);
COMMIT;
