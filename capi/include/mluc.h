/* A source, a refiner or a consumer of one's own for mluc, in C or C++. docs/CONTRACT.md says what they must do; these functions do the
 * part of it that is the same for all: joining, waiting, checking what came in, finding the points of a frame, stamps,
 * health, leaving.
 *
 *     mluc_refiner *refiner = NULL;
 *     if (mluc_refiner_open(&refiner) != MLUC_OK) { fputs(mluc_last_error(), stderr); return 1; }
 *     int32_t code = MLUC_OK;
 *     while (code == MLUC_OK || code == MLUC_TIMEOUT) {
 *         mluc_frame frame;
 *         code = mluc_refiner_wait(refiner, 100, &frame);
 *         if (code != MLUC_OK) continue;
 *         ... fill objects and indices ...
 *         code = mluc_refiner_publish(refiner, objects, objects_count, indices, indices_count, 0);
 *     }
 *     if (code < 0) fprintf(stderr, "%s\n", mluc_last_error());
 *     mluc_refiner_close(refiner);
 *
 * A consumer: mluc_consumer_open, mluc_consumer_wait again and again, mluc_consumer_close (examples/consumer-cpp).
 * A source: mluc_source_open, then mluc_source_wait and mluc_source_publish for each scan, mluc_source_finish at the end of
 * the input, mluc_source_close (examples/source-cpp).
 *
 * Link with libmluc_capi.a or libmluc_capi.so (`cargo build --release -p mluc-capi`). A handle belongs to one thread at
 * a time. In a service of Type=notify a source or a refiner says READY=1 and WATCHDOG=1 for the whole process; unset
 * NOTIFY_SOCKET before open where the program does this itself. Lengths in m, angles in rad, times in ns of CLOCK_MONOTONIC; sensor frame: x forward, y left, z up.
 */
#ifndef MLUC_H
#define MLUC_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
#define MLUC_ASSERT(condition, words) static_assert(condition, words)
extern "C" {
#else
#define MLUC_ASSERT(condition, words) _Static_assert(condition, words)
#endif

/* Of the contract that this header describes; mluc_wire_version() returns the library's. Compare them before the first open. */
#define MLUC_WIRE_VERSION 6u

/* What a call returns; negative ones are errors, and mluc_last_error() says more. */
enum {
    MLUC_OK = 0,
    MLUC_TIMEOUT = 1,        /* no frame came in time, or no scan can be taken yet: call again */
    MLUC_STOPPING = 2,       /* SIGTERM or SIGINT came: close, return 0 from main. From the first mluc_*_open on, a failed one too,
                                they no longer end the process by themselves; your own handlers from before are still called */
    MLUC_ERROR_USAGE = -1,   /* a null pointer, or a call at the wrong time, such as publish before wait */
    MLUC_ERROR_OPEN = -2,    /* another wire version, another process has the place, shared memory is full */
    MLUC_ERROR_CONTRACT = -3,/* what was to be published breaks the contract: nothing was */
    MLUC_ERROR_MEMORY = -4,  /* shared memory failed */
    MLUC_ERROR_INTERNAL = -5 /* a bug in the library */
};

/* Limits. */
#define MLUC_POINTS_MAX 262144u
#define MLUC_DETECTIONS_MAX 512u
#define MLUC_OBJECTS_MAX 512u
#define MLUC_OBJECT_POINTS_MAX 131072u
#define MLUC_CLASSES_MAX 8u
#define MLUC_FOOTPRINT_MAX 16u
#define MLUC_NONE 0xffffffffu
#define MLUC_NO_PROBABILITY (-1.0f)

/* Bits of a header's flags. */
enum {
    MLUC_LATE = 1 << 0,
    MLUC_TRUNCATED = 1 << 1,
    MLUC_DEGRADED = 1 << 2,
    MLUC_LIMIT_HIT = 1 << 3,
    MLUC_RESENT = 1 << 4,
    MLUC_NOT_FINITE = 1 << 5,
    MLUC_DAMAGED_INPUT = 1 << 6,
    MLUC_POINTS_GONE = 1 << 7,
    MLUC_EMPTY = 1 << 8,
    MLUC_INPUT_SUSPECT = 1 << 9,
    /* Which limit, beside MLUC_LIMIT_HIT. */
    MLUC_LIMIT_VOXELS = 1 << 10,
    MLUC_LIMIT_CANDIDATES = 1 << 11,
    MLUC_LIMIT_DETECTIONS = 1 << 12,
    MLUC_LIMIT_OBJECT_POINTS = 1 << 13,
    MLUC_LIMIT_WORK = 1 << 14,
    /* Why the input is suspect, beside MLUC_INPUT_SUSPECT. */
    MLUC_SUSPECT_POINTS = 1 << 15,
    MLUC_SUSPECT_UNIT = 1 << 16,
    MLUC_SUSPECT_AXES = 1 << 17,
    MLUC_SUSPECT_HEIGHT = 1 << 18,
    MLUC_SUSPECT_TILT = 1 << 19,
    MLUC_SUSPECT_BEAMS = 1 << 20,
    MLUC_SUSPECT_FIELD = 1 << 21,
    MLUC_SUSPECT_RANGE = 1 << 22,
    MLUC_SUSPECT_INTENSITY = 1 << 23,
    MLUC_SUSPECT_FROZEN = 1 << 24,
    MLUC_SUSPECT_SENSOR = 1 << 25
};

enum { MLUC_KNOWN = 0, MLUC_CANDIDATE = 1, MLUC_UNKNOWN = 1 };

/* Which gate of the head decided whether a box is known. */
enum { MLUC_GATE_NONE = 0, MLUC_GATE_EDS = 1, MLUC_GATE_UNKNOWN_PROBABILITY = 2, MLUC_GATE_SOFTMAX_MAX = 3 };

enum {
    MLUC_PUBLISHED = 0,
    MLUC_OVERLAPS_KNOWN = 1,
    MLUC_OVERLAPS_UNKNOWN = 2,
    MLUC_TOO_FEW_POINTS = 3,
    MLUC_OVERSIZED = 4,
    MLUC_INVALID_BOX = 5,
    MLUC_UNCONFIRMED = 6,
    MLUC_UNDERSIZED = 7,
    MLUC_LOW_SCORE = 8
};

/* Bits of an object's flags. Its upper bytes are numbers, each the number of steps plus one, 0: not given. Bits 8 to 15 are the age of
 * its track in scans, 16 to 23 its speed in 0.25 m/s, 24 to 31 the probability in 1/254. */
enum { MLUC_UNREFINED = 1, MLUC_SPLIT = 2, MLUC_THINNED = 4, MLUC_SMALL = 8, MLUC_LARGE = 16, MLUC_POST = 32, MLUC_CONFIRMED = 64 };

typedef struct mluc_stamps {
    uint64_t received_ns;
    uint64_t started_ns;
    uint64_t published_ns;
} mluc_stamps;

typedef struct mluc_header {
    uint32_t wire_version;
    uint32_t flags;
    uint64_t run_id; /* of the run that the frame belongs to */
    uint64_t sequence;
    uint64_t sensor_stamp_ns; /* the sensor's own time: ns since 1970 */
    uint32_t sensor_id;
    uint32_t attempt;
    uint32_t points_in;
    uint32_t points_dropped;
    uint32_t points_out_of_range;
    uint32_t feature_rows;
    uint32_t feature_channels;
    uint32_t limit_dropped;
    uint64_t model_fingerprint;
    double ego_position_m[3];
    double ego_yaw_rad;
    uint32_t ego_is_known;
    uint32_t ego_reserved;
    mluc_stamps stages[4]; /* ingest, backbone, head, refiner */
    char name[48];         /* NUL-padded; a longer name fills it without a NUL: print it with "%.48s" */
} mluc_header;

typedef struct mluc_point {
    float x_m, y_m, z_m, intensity;
} mluc_point;

typedef struct mluc_detection {
    float center_m[3];
    float size_m[3];
    float yaw_rad;
    uint32_t class_id;
    uint32_t kind; /* MLUC_KNOWN, MLUC_CANDIDATE */
    uint32_t cell;
    float objectness;
    float score;
    float probabilities[8];
    float embedding[8];
    float eds;
    float eds_normalised;
    float eds_perpendicular;
    float delta;
    float softmax_max;
    float logit_max;
    float energy;
    float unknown_probability; /* 0 to 1, or MLUC_NO_PROBABILITY */
    uint32_t gate;
    float threshold; /* of the gate, in its unit */
} mluc_detection;

typedef struct mluc_object {
    uint32_t kind; /* MLUC_KNOWN, MLUC_UNKNOWN */
    uint32_t disposition;
    uint32_t suppressed_by; /* index of the object that covers it, or MLUC_NONE */
    uint32_t class_id;
    float score;
    float center_m[3];
    float size_m[3];
    float yaw_rad;
    float eds;
    float eds_normalised;
    float unknown_probability; /* 0 to 1, or MLUC_NO_PROBABILITY */
    uint32_t gate;
    float threshold; /* of the gate, in its unit */
    uint32_t points_first; /* range in the indices */
    uint32_t points_count;
    uint32_t flags;
    uint32_t track_id; /* MLUC_NONE without tracking */
    float overlap;
    uint32_t footprint_count;
    float footprint_m[16][2]; /* counter-clockwise */
} mluc_object;

/* What holds for all frames of a run; texts are UTF-8, NUL-padded. A text that fills its field has no NUL behind it ("%.64s"). */
typedef struct mluc_run {
    uint32_t wire_version;
    uint32_t classes_count; /* 1 to MLUC_CLASSES_MAX */
    uint64_t run_id;        /* never 0 */
    uint64_t started_ns;    /* CLOCK_REALTIME */
    uint64_t model_fingerprint;
    uint64_t other_model_fingerprint; /* its frames count too, while the model changes; 0: none */
    double base_from_sensor[6]; /* x, y, z, roll, pitch, yaw */
    float sensor_height_m; /* that the model was made for */
    float objectness_min;
    uint32_t gate;
    float gate_threshold;
    char model_name[64];
    char sensor_name[64];
    char class_names[8][32];
    char known_score[96];
    char unknown_score[96];
} mluc_run;

/* Whether a missing object means that nothing is there: only in the states running and degraded. */
enum {
    MLUC_STATE_STARTING = 0,
    MLUC_STATE_RUNNING = 1,
    MLUC_STATE_DEGRADED = 2,
    MLUC_STATE_BLIND = 3,
    MLUC_STATE_LATE = 4,
    MLUC_STATE_STOPPED = 5
};

#define MLUC_NO_NUMBER UINT64_MAX

/* The element of the topic `status`: the state of the pipeline at one moment (docs/CONTRACT.md, "Status"). A refiner does not
 * need it; a consumer gets it with each wait. */
typedef struct mluc_status {
    uint32_t wire_version;
    uint32_t state;
    uint64_t run_id;
    uint64_t judged_ns; /* CLOCK_MONOTONIC */
    uint64_t sequence;  /* of the newest result, or MLUC_NO_NUMBER */
    uint64_t age_ns;    /* since the arrival of its scan, or MLUC_NO_NUMBER */
    uint64_t frames_in;
    uint64_t frames_out;
    uint64_t frames_dropped;
    uint64_t frames_late;
    uint64_t stages_out[4]; /* by ingest, backbone, head, refiner, in the run */
    uint64_t stages_late[4];
    uint64_t blind_sectors; /* bit n: 10 n to 10 (n + 1) degrees, counter-clockwise from +x */
    float not_finite_share;
    uint32_t is_ground_lost;
    char reason[192]; /* NUL-padded; print it with "%.192s" */
} mluc_status;

MLUC_ASSERT(sizeof(mluc_status) == 344, "mluc_status");
MLUC_ASSERT(sizeof(mluc_run) == 680, "mluc_run");
MLUC_ASSERT(sizeof(mluc_header) == 256, "mluc_header");
MLUC_ASSERT(offsetof(mluc_header, stages) == 112, "mluc_header");
MLUC_ASSERT(offsetof(mluc_header, name) == 208, "mluc_header");
MLUC_ASSERT(sizeof(mluc_point) == 16, "mluc_point");
MLUC_ASSERT(sizeof(mluc_detection) == 152, "mluc_detection");
MLUC_ASSERT(offsetof(mluc_detection, threshold) == 148, "mluc_detection");
MLUC_ASSERT(sizeof(mluc_object) == 220, "mluc_object");
MLUC_ASSERT(offsetof(mluc_object, footprint_m) == 92, "mluc_object");

/* Where a frame lies in shared memory: readable, not writable, until the next call with the same handle. A pointer whose count is
 * 0 points nowhere, and need not be null. */
typedef struct mluc_frame {
    const mluc_header *header;
    const mluc_run *run; /* that the frame belongs to: classes, model, gate, meaning of scores */
    const mluc_point *points; /* of the same scan, numbers unchecked; none when they are gone (MLUC_POINTS_GONE) */
    size_t points_count;
    const mluc_detection *detections; /* checked: versions, counts, classes, kinds, finite boxes */
    size_t detections_count;
} mluc_frame;

typedef struct mluc_refiner mluc_refiner;

/* The version of the contract that the library speaks. */
uint32_t mluc_wire_version(void);

/* Words of this thread's last error; valid until its next one. Never null. */
const char *mluc_last_error(void);

/* Joins the instance that MLUC_INSTANCE names ("default" without it) as its refiner, says so, and logs to stderr. Frames
 * come from its first wait on: what takes long, a network for instance, is loaded before that. */
int32_t mluc_refiner_open(mluc_refiner **refiner);

/* Waits for the newest frame, at most timeout_ms. Heartbeats go out meanwhile: call it again and again. Frames that break
 * the contract are refused and counted, and never come here. */
int32_t mluc_refiner_wait(mluc_refiner *refiner, uint32_t timeout_ms, mluc_frame *frame);

/* Publishes the objects of that frame, once: one for each detection, in their order, suppressed ones too; others may follow. indices point
 * into the frame's points; flags (MLUC_DEGRADED, ...) are added to the header's. Health counts the
 * unknown ones by disposition. */
int32_t mluc_refiner_publish(mluc_refiner *refiner, const mluc_object *objects, size_t objects_count,
                             const uint32_t *indices, size_t indices_count, uint32_t flags);

/* Leaves. Null is fine. */
void mluc_refiner_close(mluc_refiner *refiner);

/* What a pipeline says: readable until the next call with the same handle. A pointer whose count is 0 points nowhere, and need not
 * be null. */
typedef struct mluc_result {
    const mluc_header *header; /* null: no frame came */
    const mluc_run *run;
    const mluc_status *status; /* null: no supervisor has published one */
    const mluc_point *points;  /* of the scan, in shared memory, numbers unchecked; none when they are gone */
    size_t points_count;
    const mluc_object *objects; /* checked; published is what has the disposition 0 */
    size_t objects_count;
    const uint32_t *indices; /* into points: those of object o are indices[o.points_first] to [o.points_first + o.points_count - 1] */
    size_t indices_count;    /* 0: they are gone, whatever the objects say */
} mluc_result;

typedef struct mluc_consumer mluc_consumer;

/* Joins the instance that MLUC_INSTANCE names ("default" without it) as a consumer, and logs to stderr. The pipeline may
 * start later. */
int32_t mluc_consumer_open(mluc_consumer **consumer);

/* Waits for the newest frame, at most timeout_ms. Frames that break the contract are refused. With MLUC_TIMEOUT only the status
 * is given: it says whether a pipeline runs. */
int32_t mluc_consumer_wait(mluc_consumer *consumer, uint32_t timeout_ms, mluc_result *result);

/* Leaves. Null is fine. */
void mluc_consumer_close(mluc_consumer *consumer);

typedef struct mluc_source mluc_source;

/* Joins the instance that MLUC_INSTANCE names ("default" without it) as its source of scans, in ingest's place, and logs to
 * stderr. */
int32_t mluc_source_open(mluc_source **source);

/* Sleeps for wait_ms (0: not at all) while heartbeats go out. MLUC_OK: a scan can be published now, and *sequence is its number
 * in the run (a source that was started again goes on behind its predecessor's scans). MLUC_TIMEOUT: the stages behind are not
 * ready. Call it before each scan, and at least twice a second. */
int32_t mluc_source_wait(mluc_source *source, uint32_t wait_ms, uint64_t *sequence);

/* Publishes a scan: x forward, y left, z up in m, intensity 0 to 1 (not finite: 0). Points whose place is not finite, or beyond
 * MLUC_POINTS_MAX, are left out, counted and flagged. stamp_ns: the sensor's time, ns since 1970 (0: now); name: its last 48 bytes
 * (null or empty: the number). */
int32_t mluc_source_publish(mluc_source *source, const mluc_point *points, size_t points_count, uint64_t stamp_ns, const char *name);

/* The input is at its end: waits until the last scan has passed, at most timeout_ms, and ends the run. Without it a run
 * ends when a source that mluc up started exits with 0. Not after MLUC_STOPPING. */
int32_t mluc_source_finish(mluc_source *source, uint32_t timeout_ms);

/* Leaves. Null is fine. */
void mluc_source_close(mluc_source *source);

#ifdef __cplusplus
}
#endif
#endif
