-- The SELECT by which each table of the bundle is made from study.sqlite (SQLite 3.38 or newer).
-- `answer_counts`, `policy_episodes`, `participant_statuses`, `input_summaries` and `move_costs` are tables of the bundle alone: the policies'
-- moves, where each person is, and what the software computes of an episode's input and moves. All else is as the server recorded it,
-- under pseudonyms, but for what DATASHEET.md says is left out or masked.

-- table: participants
SELECT
  p.id AS participant,
  p.kind,
  p.script,
  coalesce(json_extract(y.protocol, '$.recruitment'), 'open') AS recruitment,
  p.invitation IS NOT NULL AS invited,
  p.supervised_ms IS NOT NULL AS supervised,
  p.consent_version,
  (SELECT json_extract(v.detail, '$.arm') FROM stage_events v WHERE v.participant_id = p.id AND v.kind = 'arm') AS arm,
  (SELECT coalesce(json_extract(v.detail, '$.assigned_by'), 'chance')
    FROM stage_events v WHERE v.participant_id = p.id AND v.kind = 'arm') AS arm_assigned_by,
  p.stage,
  p.joined_ms,
  p.completed_ms,
  (SELECT t.status FROM participant_statuses t WHERE t.participant_id = p.id) AS status,
  CASE
    WHEN p.kind <> 'human' THEN NULL
    WHEN p.completed_ms IS NOT NULL THEN 'finished'
    WHEN EXISTS (SELECT 1 FROM stage_events v WHERE v.participant_id = p.id AND v.kind = 'interrupted') THEN 'stopped_by_us'
    WHEN p.stage = 'withdrawn' THEN coalesce((SELECT json_extract(v.detail, '$.outcome') FROM stage_events v
      WHERE v.participant_id = p.id AND v.kind = 'withdrawn' AND json_extract(v.detail, '$.outcome') IS NOT NULL), 'withdrew')
    WHEN (SELECT l.outcome FROM series_episodes q JOIN episodes l ON l.id = q.episode_id
      WHERE q.participant_id = p.id AND q.phase = 'ranked' ORDER BY q.trial DESC LIMIT 1) = 'environment_failed' THEN 'stopped_by_us'
    ELSE 'left'
  END AS outcome,
  (coalesce(p.completed_ms, max(
    p.consent_ms,
    coalesce((SELECT max(coalesce((SELECT max(t.server_ms) FROM steps t WHERE t.episode_id = l.id), l.started_ms))
      FROM series_episodes q JOIN episodes l ON l.id = q.episode_id WHERE q.participant_id = p.id), 0),
    coalesce((SELECT max(v.at_ms) FROM stage_events v
      WHERE v.participant_id = p.id AND v.kind IN ('stage', 'withdrawn')), 0)
  )) - p.consent_ms) / 60000.0 AS minutes,
  json_extract(p.settings, '$.modality') AS modality,
  json_extract(p.settings, '$.palette') AS palette,
  CASE WHEN json_array_length(y.protocol, '$.languages') > 1 THEN json_extract(p.settings, '$.language')
    ELSE coalesce(json_extract(y.protocol, '$.languages[0]'), 'en') END AS language,
  1 + (SELECT count(*) FROM stage_events v WHERE v.participant_id = p.id AND v.kind = 'moved') AS devices,
  (SELECT count(*) FROM stage_events v WHERE v.participant_id = p.id AND v.kind = 'answers') AS attempts,
  (SELECT json_group_array(json(a.answers)) FROM (
    SELECT coalesce(json_extract(v.detail, '$.answers'), '[]') AS answers FROM stage_events v
    WHERE v.participant_id = p.id AND v.kind = 'answers' ORDER BY v.number) a) AS answers,
  (SELECT count(*) FROM stage_events v WHERE v.participant_id = p.id AND v.kind = 'deviation') AS deviations,
  count(r.id) AS ranked_episodes,
  count(r.id) FILTER (WHERE r.driver = 'human') AS ranked_by_human,
  count(r.id) FILTER (WHERE r.attestation = 'unattested') AS ranked_unattested,
  count(r.id) FILTER (WHERE r.attestation = 'spoilt') AS ranked_spoilt,
  count(r.id) FILTER (WHERE r.attestation = 'attested') AS ranked_attested,
  count(r.id) FILTER (WHERE r.attestation = 'supervised') AS ranked_supervised,
  count(r.id) FILTER (WHERE i.labels <> '[]') AS ranked_labelled,
  (SELECT group_concat(label, '; ') FROM (
    SELECT DISTINCT each.value AS label
    FROM series_episodes q JOIN input_summaries j ON j.episode_id = q.episode_id, json_each(j.labels) each
    WHERE q.participant_id = p.id AND q.phase = 'ranked' ORDER BY 1)) AS labels,
  max(i.pause_share) AS max_pause_share,
  avg(i.pause_share) AS mean_pause_share
FROM participants p
JOIN series y ON y.name = p.study
LEFT JOIN series_episodes s ON s.participant_id = p.id AND s.phase = 'ranked'
LEFT JOIN episodes r ON r.id = s.episode_id
LEFT JOIN input_summaries i ON i.episode_id = s.episode_id
GROUP BY p.id
ORDER BY p.joined_ms, p.id;

-- table: episodes
SELECT
  p.id AS participant,
  p.kind,
  s.phase,
  s.trial,
  s.terrain AS terrain_index,
  e.id AS episode,
  e.driver,
  e.attestation,
  e.attestation_reason,
  p.script,
  e.task,
  e.level,
  json_extract(e.config, '$.rows') AS rows,
  json_extract(e.config, '$.cols') AS cols,
  json_extract(e.config, '$.sensor_radius') AS sensor_radius,
  json_extract(e.config, '$.beta') AS beta,
  json_extract(e.config, '$.max_steps') AS max_steps,
  e.config_hash,
  e.seed,
  e.start_row,
  e.start_col,
  CASE e.terrain WHEN x'' THEN '' ELSE 'x' || lower(hex(e.terrain)) END AS terrain,
  e.core_version,
  e.started_ms,
  e.ended_ms,
  e.outcome,
  e.steps,
  e.discovered,
  1.0 * e.discovered / (json_extract(e.config, '$.rows') * json_extract(e.config, '$.cols')) AS coverage,
  e.total AS "return",
  e.score,
  CASE WHEN e.outcome IN ('explored', 'succeeded') THEN e.steps ELSE json_extract(e.config, '$.max_steps') END AS steps_to_99,
  (SELECT group_concat(value, '; ') FROM json_each(i.labels)) AS labels,
  i.lowest,
  i.pause_share,
  i.active_ms,
  e.trajectory_hash
FROM episodes e
JOIN series_episodes s ON s.episode_id = e.id
JOIN participants p ON p.id = s.participant_id
JOIN input_summaries i ON i.episode_id = e.id
ORDER BY e.started_ms, e.id;

-- table: steps
SELECT
  s.participant_id AS participant,
  t.episode_id AS episode,
  t.step,
  t.action, -- its code: the tables have the name that it has in the task
  -- an invalid move, which is always the last one, leaves the rover where it was; other tasks have no rover
  CASE WHEN e.task = 'mars' THEN e.start_row + sum(
    CASE WHEN t.step = e.steps - 1 AND e.outcome IN ('collided', 'out_of_bounds') THEN 0
    ELSE CASE t.action WHEN 0 THEN -1 WHEN 2 THEN 1 ELSE 0 END END) OVER moves END AS row,
  CASE WHEN e.task = 'mars' THEN e.start_col + sum(
    CASE WHEN t.step = e.steps - 1 AND e.outcome IN ('collided', 'out_of_bounds') THEN 0
    ELSE CASE t.action WHEN 1 THEN 1 WHEN 3 THEN -1 ELSE 0 END END) OVER moves END AS col,
  t.discovered,
  1.0 * t.discovered / (json_extract(e.config, '$.rows') * json_extract(e.config, '$.cols')) AS coverage,
  t.reward,
  t.server_ms,
  t.client_ms,
  t.key_down_ms,
  t.key_up_ms,
  t.input,
  t.driver
FROM steps t
JOIN episodes e ON e.id = t.episode_id
JOIN series_episodes s ON s.episode_id = e.id
WINDOW moves AS (PARTITION BY t.episode_id ORDER BY t.step)
ORDER BY e.started_ms, e.id, t.step;

-- table: input_events
SELECT
  s.participant_id AS participant,
  v.episode_id AS episode,
  v.number,
  v.tab,
  v.page_load,
  v.kind AS event,
  v.code,
  v.repeat,
  v.trusted,
  v.client_ms,
  v.step,
  v.round_trip_ms,
  v.server_ms
FROM input_events v
JOIN episodes e ON e.id = v.episode_id
JOIN series_episodes s ON s.episode_id = e.id
ORDER BY e.started_ms, e.id, v.number;

-- table: answers
SELECT participant_id AS participant, block, turn, question, part, answer, place, answered_ms
FROM answers
ORDER BY participant_id, block, turn, question, part;

-- table: free_texts
SELECT participant_id AS participant, block, turn, question, words
FROM free_texts
ORDER BY participant_id, block, turn, question;

-- table: answer_counts
SELECT block, turn, question, part, asked, answers, people, mean, sd
FROM answer_counts
ORDER BY place;

-- table: policy_episodes
SELECT
  policy,
  policy_hash,
  terrain_index,
  seed,
  outcome,
  steps,
  steps_to_99,
  score,
  actions,
  trajectory_hash
FROM policy_episodes
ORDER BY place, terrain_index;

-- table: move_costs
SELECT
  s.participant_id AS participant,
  m.episode_id AS episode,
  m.step,
  m.action,
  m.cost,
  m.expert_action,
  m.kind
FROM move_costs m
JOIN episodes e ON e.id = m.episode_id
JOIN series_episodes s ON s.episode_id = e.id
ORDER BY e.started_ms, e.id, m.step;

-- table: scores
SELECT
  p.id AS participant,
  p.kind,
  s.phase,
  s.trial,
  s.terrain AS terrain_index,
  e.id AS episode,
  e.driver,
  e.attestation,
  e.seed,
  e.started_ms,
  e.ended_ms,
  e.outcome,
  e.steps,
  e.discovered,
  1.0 * e.discovered / (json_extract(e.config, '$.rows') * json_extract(e.config, '$.cols')) AS coverage,
  e.total AS "return",
  e.score,
  CASE WHEN e.outcome IN ('explored', 'succeeded') THEN e.steps ELSE json_extract(e.config, '$.max_steps') END AS steps_to_99
FROM episodes e
JOIN series_episodes s ON s.episode_id = e.id
JOIN participants p ON p.id = s.participant_id
ORDER BY e.started_ms, e.id;
