/* What was noticed: bits that are added up. */
enum {
<<anomalies>>
};
