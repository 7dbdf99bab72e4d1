/* Steps a scene with a mesh that is handed over and moved, saves states and goes back to them, runs it as a whole, and misuses
   every function. Arguments: the folder to write to, the scene file. Says "all is well" at the end. */
#include "drapery.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#define CHECK(condition)                                                                  \
    do {                                                                                  \
        if (!(condition)) {                                                               \
            fprintf(stderr, "%s:%d: not so: %s\n", __FILE__, __LINE__, #condition);       \
            exit(1);                                                                      \
        }                                                                                 \
    } while (0)

static drapery_error *error;

/* Ends the program where something went wrong, with the words of the library. */
static void done(int32_t code)
{
    if (code != DRAPERY_DONE) {
        fprintf(stderr, "code %d: %s\n", code, error ? drapery_error_message(error) : "no error");
        exit(1);
    }
    CHECK(error == NULL);
}

/* What has to go wrong, and with which words. */
static void refused(int32_t code, int32_t expected, const char *words)
{
    CHECK(error != NULL);
    if (code != expected || drapery_error_code(error) != expected || !strstr(drapery_error_message(error), words)) {
        fprintf(stderr, "code %d in the place of %d (%s): %s\n", code, expected, words, drapery_error_message(error));
        exit(1);
    }
    drapery_error_free(error);
    drapery_error_free(error); /* A second time is no harm. */
    CHECK(drapery_error_message(error) == NULL);
    error = NULL;
}

static bool always(void *user)
{
    ++*(int *)user;
    return true;
}

/* What freeing a simulation from within a call of it returns. */
struct freed {
    drapery_simulation *simulation;
    int32_t code;
};

static bool frees(void *user)
{
    struct freed *freed = user;
    freed->code = drapery_simulation_free(freed->simulation);
    return true;
}

static void count_frames(const drapery_frame_report *report, void *user)
{
    CHECK(report->done <= report->total && report->last_frame == 1004);
    ++*(int *)user;
}

/* The top of a table, which rises. */
static void table(double points[5][3], int frame)
{
    const double corners[4][2] = {{-1, -1}, {-1, 1}, {1, 1}, {1, -1}};
    for (int i = 0; i < 4; ++i) {
        points[i][0] = 0.3 * corners[i][0];
        points[i][1] = -0.02 + 0.01 * (frame - 1001);
        points[i][2] = 0.3 * corners[i][1];
    }
    points[4][0] = points[4][2] = 0;
    points[4][1] = -0.5;
}

int main(int count, char **arguments)
{
    CHECK(count == 3);
    char path[4096];
    const char *folder = arguments[1];
    CHECK(drapery_abi_version() == DRAPERY_ABI_VERSION && strstr(drapery_version(), "Drapery"));
    done(drapery_set_threads(2, &error));
    refused(drapery_set_threads(2, &error), DRAPERY_USAGE, "once");

    /* A scene, and what it refuses. */
    drapery_scene *scene = NULL;
    refused(drapery_scene_open(NULL, &scene, &error), DRAPERY_USAGE, "`path`: it is null");
    refused(drapery_scene_open("x.toml", NULL, &error), DRAPERY_USAGE, "`scene`: it is null");
    refused(drapery_scene_open("\xff", &scene, &error), DRAPERY_USAGE, "not UTF-8");
    CHECK(drapery_scene_open(NULL, NULL, NULL) == DRAPERY_USAGE);
    refused(drapery_scene_parse("drapery = 1\n[gravty]\n", "wrong.toml", "", &scene, &error), DRAPERY_SCENE, "gravity");
    done(drapery_scene_open("no such file.toml", &scene, &error));
    refused(drapery_scene_check(scene, &error), DRAPERY_MISSING_INPUT, "no such file.toml");
    CHECK(drapery_scene_free(scene) == DRAPERY_DONE && drapery_scene_free(scene) == DRAPERY_USAGE);
    refused(drapery_scene_check(scene, &error), DRAPERY_USAGE, "no handle of a scene");
    refused(drapery_scene_check(NULL, &error), DRAPERY_USAGE, "no handle of a scene");
    refused(drapery_scene_check((drapery_scene *)&scene, &error), DRAPERY_USAGE, "no handle of a scene");
    done(drapery_scene_open(arguments[2], &scene, &error));
    refused(drapery_scene_check(scene, &error), DRAPERY_BAD_INPUT, "memory:table");
    double points[5][3];
    table(points, 1001);
    uint32_t counts[] = {4, 3, 3, 3, 3}, corners[] = {0, 1, 2, 3, 1, 0, 4, 2, 1, 4, 3, 2, 4, 0, 3, 4};
    refused(drapery_scene_add_mesh(scene, "table", NULL, 5, counts, 5, corners, 16, &error), DRAPERY_USAGE, "`positions`");
    refused(drapery_scene_add_mesh(scene, "table", &points[0][0], SIZE_MAX / 2, counts, 5, corners, 16, &error),
            DRAPERY_USAGE, "no array of this length");
    refused(drapery_scene_add_mesh(scene, "table", &points[0][0], 5, counts, 5, corners, 15, &error),
            DRAPERY_BAD_INPUT, "16 corners in all, and 15 are given");
    done(drapery_scene_add_mesh(scene, "table", &points[0][0], 5, counts, 5, corners, 16, &error));
    refused(drapery_scene_set(scene, "shot.fraems", "\"1-2\"", &error), DRAPERY_SCENE, "fraems");
    done(drapery_scene_set(scene, "resolution", "9", &error));
    done(drapery_scene_check(scene, &error));

    /* A simulation at its start. */
    drapery_simulation *simulation = NULL;
    refused(drapery_simulation_new((drapery_scene *)scene, NULL, &error), DRAPERY_USAGE, "`simulation`");
    done(drapery_simulation_new(scene, &simulation, &error));
    refused(drapery_scene_check((drapery_scene *)simulation, &error), DRAPERY_USAGE, "no handle of a scene");
    int64_t start, first, last, frame;
    uint32_t numerator, denominator;
    done(drapery_simulation_frames(simulation, &start, &first, &last, &error));
    CHECK(start == 1000 && first == 1001 && last == 1004);
    done(drapery_simulation_fps(simulation, &numerator, &denominator, &error));
    CHECK(numerator == 24 && denominator == 1);
    CHECK(drapery_simulation_garment_count(simulation) == 1 && drapery_simulation_body_count(simulation) == 1);
    CHECK(strcmp(drapery_simulation_garment_name(simulation, 0), "cloth") == 0);
    CHECK(strcmp(drapery_simulation_body_name(simulation, 0), "table") == 0);
    CHECK(drapery_simulation_garment_name(simulation, 1) == NULL);
    const uint32_t *face_counts, *face_corners;
    size_t face_count, corner_count, point_count;
    done(drapery_simulation_faces(simulation, 0, &face_counts, &face_count, &face_corners, &corner_count, &error));
    CHECK(face_count == 2 * 9 * 9 && corner_count == 3 * face_count && face_counts[0] == 3);
    const double *positions, *velocities;
    done(drapery_simulation_positions(simulation, 0, &positions, &point_count, &error));
    CHECK(point_count == 100 && face_corners[corner_count - 1] < point_count);
    refused(drapery_simulation_positions(simulation, 1, &positions, &point_count, &error), DRAPERY_USAGE, "garment 1");
    CHECK(positions == NULL && point_count == 0);

    /* Bodies that cannot be there. */
    table(points, 1002);
    points[3][1] /= 0.0;
    refused(drapery_simulation_move_body(simulation, 0, &points[0][0], 4, &error), DRAPERY_BAD_INPUT, "4 places");
    CHECK(drapery_simulation_move_body(simulation, 0, &points[0][0], 5, &error) == DRAPERY_BAD_INPUT);
    uint64_t element;
    CHECK(drapery_error_frame(error, &frame) && frame == 1001 && drapery_error_element(error, &element) && element == 3);
    CHECK(strcmp(drapery_error_object(error), "table") == 0 && drapery_error_frame(error, NULL));
    drapery_error_free(error);
    refused(drapery_simulation_move_body(simulation, 1, &points[0][0], 5, &error), DRAPERY_USAGE, "body 1");

    /* Numbers of the scene. */
    double gravity[3] = {0, -9.81, 0};
    refused(drapery_simulation_set(simulation, "gravity.acelerate", gravity, 3, &error), DRAPERY_SCENE, "has no number");
    refused(drapery_simulation_set(simulation, "gravity.acceleration", gravity, 1, &error), DRAPERY_SCENE, "three numbers");
    refused(drapery_simulation_set(simulation, "gravity.acceleration", gravity, 2, &error), DRAPERY_BAD_INPUT, "2 numbers");
    done(drapery_simulation_set(simulation, "gravity.acceleration", gravity, 3, &error));

    /* Frames, with a cancelled one and states to go back to. */
    drapery_state *state = NULL, *within = NULL;
    int asked = 0;
    double *before = NULL;
    for (frame = 1001; frame <= 1004; ++frame) {
        table(points, (int)frame);
        done(drapery_simulation_move_body(simulation, 0, &points[0][0], 5, &error));
        if (frame == 1003) {
            done(drapery_simulation_save(simulation, &state, &error));
            CHECK(drapery_simulation_advance(simulation, always, &asked, &error) == DRAPERY_CANCELLED);
            CHECK(asked == 1 && error == NULL);
            done(drapery_simulation_save(simulation, &within, &error));
        }
        done(drapery_simulation_advance(simulation, NULL, NULL, &error));
    }
    refused(drapery_simulation_advance(simulation, NULL, NULL, &error), DRAPERY_USAGE, "ends at frame 1004");
    drapery_summary summary;
    done(drapery_simulation_summary(simulation, &summary, &error));
    CHECK(summary.frame == 1004 && summary.steps > 0 && summary.kinetic_energy > 0);
    const char *name;
    uint64_t value;
    CHECK(drapery_simulation_metric_count(simulation) > 0 && drapery_simulation_metric(simulation, 0, &name, &value));
    done(drapery_simulation_positions(simulation, 0, &positions, &point_count, &error));
    done(drapery_simulation_velocities(simulation, 0, &velocities, &point_count, &error));
    before = malloc(sizeof(double) * 3 * point_count);
    memcpy(before, positions, sizeof(double) * 3 * point_count);
    snprintf(path, sizeof path, "%s/state.h5", folder);
    done(drapery_simulation_save_file(simulation, path, &error));
    for (int round = 0; round < 2; ++round) {
        done(drapery_simulation_restore(simulation, round ? within : state, &error));
        done(drapery_simulation_frame(simulation, &frame, &error));
        CHECK(frame == 1002);
        done(drapery_simulation_advance(simulation, NULL, NULL, &error));
        table(points, 1004);
        done(drapery_simulation_move_body(simulation, 0, &points[0][0], 5, &error));
        done(drapery_simulation_advance(simulation, NULL, NULL, &error));
        done(drapery_simulation_positions(simulation, 0, &positions, &point_count, &error));
        CHECK(memcmp(before, positions, sizeof(double) * 3 * point_count) == 0);
    }

    /* Another simulation takes the file, and not the state. */
    drapery_simulation *other = NULL;
    done(drapery_simulation_new(scene, &other, &error));
    refused(drapery_simulation_restore(other, state, &error), DRAPERY_USAGE, "another simulation");
    refused(drapery_simulation_restore_file(other, "no such state.h5", &error), DRAPERY_MISSING_INPUT, "no such state");
    refused(drapery_simulation_save_file(other, "no/such/folder/state.h5", &error), DRAPERY_CANNOT_CREATE, "folder");
    char pipe[4096];
    struct stat about;
    snprintf(pipe, sizeof pipe, "%s/pipe.h5", folder);
    CHECK(mkfifo(pipe, 0600) == 0);
    refused(drapery_simulation_save_file(other, pipe, &error), DRAPERY_CANNOT_CREATE, "this is a pipe");
    CHECK(stat(pipe, &about) == 0 && S_ISFIFO(about.st_mode));
    done(drapery_simulation_restore_file(other, path, &error));
    done(drapery_simulation_positions(other, 0, &positions, &point_count, &error));
    CHECK(memcmp(before, positions, sizeof(double) * 3 * point_count) == 0);
    free(before);

    /* A callback cannot free what calls it. */
    done(drapery_simulation_restore(simulation, state, &error));
    struct freed freed = {simulation, DRAPERY_DONE};
    CHECK(drapery_simulation_advance(simulation, frees, &freed, &error) == DRAPERY_CANCELLED);
    CHECK(freed.code == DRAPERY_USAGE);
    done(drapery_simulation_advance(simulation, NULL, NULL, &error));

    /* A whole shot: cancelled, gone on with, and there already. */
    int frames = 0;
    snprintf(path, sizeof path, "%s/run", folder);
    CHECK(drapery_run(scene, path, 0, NULL, always, &asked, &error) == DRAPERY_CANCELLED && error == NULL);
    done(drapery_run(scene, path, 0, count_frames, NULL, &frames, &error));
    CHECK(frames > 0);
    done(drapery_run(scene, path, 0, NULL, NULL, NULL, &error));
    done(drapery_run(scene, path, DRAPERY_RUN_OVERWRITE, NULL, NULL, NULL, &error));

    CHECK(drapery_state_free((drapery_state *)scene) == DRAPERY_USAGE && drapery_state_free(NULL) == DRAPERY_DONE);
    CHECK(drapery_state_free(state) == DRAPERY_DONE && drapery_state_free(state) == DRAPERY_USAGE);
    refused(drapery_simulation_restore(simulation, state, &error), DRAPERY_USAGE, "no handle of a state");
    CHECK(drapery_state_free(within) == DRAPERY_DONE && drapery_scene_free(scene) == DRAPERY_DONE);
    CHECK(drapery_simulation_free(simulation) == DRAPERY_DONE && drapery_simulation_free(simulation) == DRAPERY_USAGE);
    refused(drapery_simulation_advance(simulation, NULL, NULL, &error), DRAPERY_USAGE, "no handle of a simulation");
    CHECK(drapery_simulation_positions(simulation, 0, &positions, &point_count, NULL) == DRAPERY_USAGE);
    CHECK(drapery_simulation_garment_count(simulation) == 0 && !drapery_simulation_metric(simulation, 0, &name, &value));
    CHECK(drapery_simulation_free(other) == DRAPERY_DONE);
    puts("all is well");
    return 0;
}
