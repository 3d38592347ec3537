/* What was noticed: bits that are added up. */
enum {
<<for name, bit, comma, text in anomalies|\n>>  <<P>>_ANOMALY_<<name>> = <<bit>><<comma>> /* <<text>> */<<end>>
};
