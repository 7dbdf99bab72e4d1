/* Drapery, an offline cloth solver: its interface for C and C++. docs/reference/c_api.md says how it is used.

   Every function may be called from any thread; one call at a time with the same handle. A handle that was freed, or is of
   another kind, is an error and nothing worse. All lengths are in metres with Y up, times in seconds, texts in UTF-8.

   Made of plugins/capi/src; do not change it by hand. */

#ifndef DRAPERY_H
#define DRAPERY_H

#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>

/*
 Version of the interface that this header is of. Functions are added to a version and never taken away or changed; a program
 that was built with an older header of the same version keeps working.
 */
#define DRAPERY_ABI_VERSION 1

/*
 Everything is as it was asked for.
 */
#define DRAPERY_DONE 0

/*
 The request is not possible: a handle of another kind, a null pointer, a frame that the shot does not have.
 */
#define DRAPERY_USAGE 2

/*
 An input holds data that cannot be used.
 */
#define DRAPERY_BAD_INPUT 65

/*
 An input file is missing.
 */
#define DRAPERY_MISSING_INPUT 66

/*
 A bug in Drapery itself. The handle that was used can only be freed.
 */
#define DRAPERY_INTERNAL 70

/*
 The machine has too little memory for the shot.
 */
#define DRAPERY_NO_MEMORY 71

/*
 An output could not be created, or holds another run.
 */
#define DRAPERY_CANNOT_CREATE 73

/*
 Reading or writing failed.
 */
#define DRAPERY_IO 74

/*
 A callback has cancelled it; called again, it resumes there.
 */
#define DRAPERY_CANCELLED 75

/*
 The scene is wrong.
 */
#define DRAPERY_SCENE 78

/*
 The solver gave up.
 */
#define DRAPERY_SOLVER_GAVE_UP 80

/*
 Replaces a run that the folder holds, instead of resuming it.
 */
#define DRAPERY_RUN_OVERWRITE 1

/*
 Error of a call. Functions that can fail take the address of such a pointer as their last argument; it is set to null where
 nothing went wrong. Null in its place is allowed: the code that is returned then says all.
 */
typedef struct drapery_error drapery_error;

/*
 A scene: where it comes from, and what is set in it. Nothing is read before it is checked, simulated or run.
 */
typedef struct drapery_scene drapery_scene;

/*
 A scene at some frame. Any thread may use it, one at a time; a call while another is under way is an error.
 */
typedef struct drapery_simulation drapery_simulation;

/*
 A state of a simulation. It belongs to that simulation; others of the same scene take it from a file.
 */
typedef struct drapery_state drapery_state;

/*
 A frame that is on the disk.
 */
typedef struct drapery_frame_report {
    /*
     Number of the frame.
     */
    int64_t frame;
    /*
     Last frame of the run.
     */
    int64_t last_frame;
    /*
     Frames done so far, pre-roll and those of earlier attempts included.
     */
    uint64_t done;
    /*
     Frames in all, pre-roll included.
     */
    uint64_t total;
    /*
     Seconds it took, reading and writing included.
     */
    double seconds;
    /*
     Time steps; 0 for the frame at which the simulation starts.
     */
    uint64_t steps;
} drapery_frame_report;

/*
 Called for every frame, on the thread that runs the shot; the report lives as long as the call. `user` is what came with it.
 */
typedef void (*drapery_progress)(const struct drapery_frame_report *report,
                                 void *user);

/*
 Whether to stop. Called at every state free of collisions, from any thread, one at a time: it has to be quick, and may not
 call a function with the same simulation. `user` is what came with it.
 */
typedef bool (*drapery_cancel)(void *user);

/*
 Summary of the work done to reach a frame.
 */
typedef struct drapery_summary {
    /*
     Number of the frame.
     */
    int64_t frame;
    /*
     Time steps.
     */
    uint64_t steps;
    /*
     Iterations of all damping solves.
     */
    uint64_t cg_iterations;
    /*
     Shortest step [s].
     */
    double dt_min;
    /*
     Longest step [s].
     */
    double dt_max;
    /*
     Kinetic energy at the frame [J].
     */
    double kinetic_energy;
    /*
     Potential energy at the frame [J].
     */
    double potential_energy;
    /*
     Relative change of the length of the most stretched edge; 0 where there is none.
     */
    double max_strain;
} drapery_summary;

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

/*
 Version of the interface of the library that is loaded: a program compares it with DRAPERY_ABI_VERSION of its header.
 */
uint32_t drapery_abi_version(void);

/*
 Name and version of the library, for messages; never null, never to be freed.
 */
const char *drapery_version(void);

/*
 Sets the number of threads of all simulations of this process; 0 takes one for each processor. To be called once, before
 anything is simulated; without it there is one for each processor. The number of threads changes no bit of a result.

 Errors: threads run already.
 */
int32_t drapery_set_threads(size_t count,
                            struct drapery_error **error);

/*
 One of the codes above; DRAPERY_DONE for null.
 */
int32_t drapery_error_code(const struct drapery_error *error);

/*
 All of it in words, in UTF-8: what, where, and what to do. Lives as long as the error; null for null.
 */
const char *drapery_error_message(const struct drapery_error *error);

/*
 Name of the garment or body, or path of the file, that is meant; null if there is none. Lives as long as the error.
 */
const char *drapery_error_object(const struct drapery_error *error);

/*
 Whether a frame is meant; `frame` then gets its number.

 What the caller promises:
 `frame` is null or the address of a number.
 */
bool drapery_error_frame(const struct drapery_error *error,
                         int64_t *frame);

/*
 Whether a vertex, face, edge or corner is meant, or a line of the scene; `element` then gets its number: lines are counted
 from 1, all else from 0.

 What the caller promises:
 `element` is null or the address of a number.
 */
bool drapery_error_element(const struct drapery_error *error,
                           uint64_t *element);

/*
 Frees an error. Null, and what was freed before, are left alone.
 */
void drapery_error_free(struct drapery_error *error);

/*
 Runs a whole shot into a folder: caches, checkpoints and the record of the run, with the bytes that `drapery run` writes. A
 run that the folder holds resumes after its last checkpoint, unless `flags` has DRAPERY_RUN_OVERWRITE. `progress` and `cancel`
 may be null. Returns DRAPERY_CANCELLED, without an error, where it was cancelled: a checkpoint is written, and the next run
 goes on from there.

 Errors: the scene or its inputs are wrong; the folder holds another run, is in use or cannot be written; the solver gives up.

 What the caller promises:
 `folder` ends with a zero; `progress` and `cancel` may be called with `user`; `error` is the address of a pointer or null.
 */
int32_t drapery_run(const struct drapery_scene *scene,
                    const char *folder,
                    uint32_t flags,
                    drapery_progress progress,
                    drapery_cancel cancel,
                    void *user,
                    struct drapery_error **error);

/*
 A scene of the file at `path`.

 What the caller promises:
 `path` is a text that ends with a zero, `scene` the address of a pointer, `error` that of one or null.
 */
int32_t drapery_scene_open(const char *path,
                           struct drapery_scene **scene,
                           struct drapery_error **error);

/*
 A scene of the text of a scene file, `toml`. `name` is what messages call it, and the shot where it has none; files that it
 names are relative to `folder` ("" for the folder of the process). Meshes that are added to it, it names "memory:NAME" in the
 place of files.

 What the caller promises:
 The texts end with a zero, `scene` is the address of a pointer, `error` that of one or null.
 */
int32_t drapery_scene_parse(const char *toml,
                            const char *name,
                            const char *folder,
                            struct drapery_scene **scene,
                            struct drapery_error **error);

/*
 Sets a value of the scene, as `--set KEY=VALUE` of the command: a parameter or a dotted key, and its value in TOML.

 Errors: the scene cannot be read, or has no place for it; nothing is set then.

 What the caller promises:
 The texts end with a zero; `error` is the address of a pointer or null.
 */
int32_t drapery_scene_set(struct drapery_scene *scene,
                          const char *key,
                          const char *value,
                          struct drapery_error **error);

/*
 Adds a folder in which the materials that the scene names are looked for.

 What the caller promises:
 `folder` ends with a zero; `error` is the address of a pointer or null.
 */
int32_t drapery_scene_add_materials(struct drapery_scene *scene,
                                    const char *folder,
                                    struct drapery_error **error);

/*
 Adds a mesh, which the scene names "memory:NAME", in the place of one of the same name: `point_count` points of three numbers
 each, in metres with Y up; `face_count` numbers of corners; and `corner_count` numbers of points, face by face,
 counter-clockwise seen from outside. All is copied.

 Errors: the numbers do not fit each other, with the face, corner or vertex.

 What the caller promises:
 The arrays are as long as it says; `name` ends with a zero; `error` is the address of a pointer or null.
 */
int32_t drapery_scene_add_mesh(struct drapery_scene *scene,
                               const char *name,
                               const double *positions,
                               size_t point_count,
                               const uint32_t *face_counts,
                               size_t face_count,
                               const uint32_t *corners,
                               size_t corner_count,
                               struct drapery_error **error);

/*
 Reads the scene and all its inputs over all frames, as `drapery check` does, and keeps nothing of it.

 Errors: everything that is wrong, in one message; object and element are those of the first.

 What the caller promises:
 `error` is the address of a pointer or null.
 */
int32_t drapery_scene_check(const struct drapery_scene *scene,
                            struct drapery_error **error);

/*
 Frees a scene. Simulations of it stay valid. Returns DRAPERY_USAGE for what is no handle of a scene, was freed before, or
 is used by a call that has not returned, and leaves it alone; null is allowed.
 */
int32_t drapery_scene_free(struct drapery_scene *scene);

/*
 A simulation of a scene at its start, with all inputs checked. The scene may be changed or freed afterwards.

 Errors: as drapery_scene_check.

 What the caller promises:
 `simulation` is the address of a pointer, `error` that of one or null.
 */
int32_t drapery_simulation_new(const struct drapery_scene *scene,
                               struct drapery_simulation **simulation,
                               struct drapery_error **error);

/*
 Frees a simulation, and with it all arrays that were looked at. Returns DRAPERY_USAGE for what is no handle of a simulation,
 was freed before, or is used by a call that has not returned (a callback asks within one), and leaves it alone; null is allowed.
 */
int32_t drapery_simulation_free(struct drapery_simulation *simulation);

/*
 Says at which frame the simulation is: that of the start, pre-roll included, at first.

 What the caller promises:
 `frame` is the address of a number or null, `error` that of a pointer or null.
 */
int32_t drapery_simulation_frame(const struct drapery_simulation *simulation,
                                 int64_t *frame,
                                 struct drapery_error **error);

/*
 Says where the simulation starts, and which the first and the last frame of the shot are; the frames before the first are its
 pre-roll.

 What the caller promises:
 `start`, `first` and `last` are addresses of numbers or null, `error` that of a pointer or null.
 */
int32_t drapery_simulation_frames(const struct drapery_simulation *simulation,
                                  int64_t *start,
                                  int64_t *first,
                                  int64_t *last,
                                  struct drapery_error **error);

/*
 Says the frames per second, as a fraction.

 What the caller promises:
 `numerator` and `denominator` are addresses of numbers or null, `error` that of a pointer or null.
 */
int32_t drapery_simulation_fps(const struct drapery_simulation *simulation,
                               uint32_t *numerator,
                               uint32_t *denominator,
                               struct drapery_error **error);

/*
 Puts a body that is a mesh where it is to be at the next frame: `point_count` points of three numbers each, in metres with Y
 up, as many as the mesh has. All is copied. The body moves there on straight lines and stays until it is put elsewhere: the
 scene no longer moves it.

 Errors: there is no such body (DRAPERY_USAGE), or it is an analytic shape; points are missing, or are no place, with the vertex;
 a frame was cancelled on the way and is not finished.

 What the caller promises:
 The array is as long as it says; `error` is the address of a pointer or null.
 */
int32_t drapery_simulation_move_body(struct drapery_simulation *simulation,
                                     size_t body,
                                     const double *positions,
                                     size_t point_count,
                                     struct drapery_error **error);

/*
 Gives a number of the scene another value from the next frame on, by its path, as in `garment.skirt.stretch.stiffness`,
 `body.hero.friction` or `gravity.acceleration`: one number, or the three of a vector, in SI units. States do not hold it.

 Errors: the scene has no such number, the value does not fit it, or a curve of the scene changes it; a frame was cancelled on
 the way and is not finished.

 What the caller promises:
 The path ends with a zero, the array is as long as it says; `error` is the address of a pointer or null.
 */
int32_t drapery_simulation_set(struct drapery_simulation *simulation,
                               const char *path,
                               const double *value,
                               size_t count,
                               struct drapery_error **error);

/*
 Simulates up to the next frame, or until `cancel` says so; null never does. Arrays that were looked at before are gone. Returns
 DRAPERY_CANCELLED, without an error, where it was cancelled: called again, it resumes, and the result equals that of a frame that
 was never cancelled, bit for bit.

 Errors: the last frame of the shot is reached; an input breaks; the solver gives up, which leaves the last good state.

 What the caller promises:
 `cancel` may be called with `user`; `error` is the address of a pointer or null.
 */
int32_t drapery_simulation_advance(struct drapery_simulation *simulation,
                                   drapery_cancel cancel,
                                   void *user,
                                   struct drapery_error **error);

/*
 Says what was done to reach the present frame; zeros at the start.

 What the caller promises:
 `summary` is the address of one or null, `error` that of a pointer or null.
 */
int32_t drapery_simulation_summary(const struct drapery_simulation *simulation,
                                   struct drapery_summary *summary,
                                   struct drapery_error **error);

/*
 Saves the present state in memory.

 What the caller promises:
 `state` is the address of a pointer, `error` that of one or null.
 */
int32_t drapery_simulation_save(const struct drapery_simulation *simulation,
                                struct drapery_state **state,
                                struct drapery_error **error);

/*
 Goes back to a state, or forward; from there the frames have the same bits as before. Arrays that were looked at are gone.

 Errors: the state belongs to another simulation.

 What the caller promises:
 `error` is the address of a pointer or null.
 */
int32_t drapery_simulation_restore(struct drapery_simulation *simulation,
                                   const struct drapery_state *state,
                                   struct drapery_error **error);

/*
 Frees a state. Returns DRAPERY_USAGE for what is no handle of a state, was freed before, or is used by a call that has not
 returned, and leaves it alone; null is allowed.
 */
int32_t drapery_state_free(struct drapery_state *state);

/*
 Saves the present state in a file, which appears as a whole or not at all.

 Errors: the file cannot be written; an input of the scene can no longer be read.

 What the caller promises:
 `path` ends with a zero; `error` is the address of a pointer or null.
 */
int32_t drapery_simulation_save_file(const struct drapery_simulation *simulation,
                                     const char *path,
                                     struct drapery_error **error);

/*
 Resumes from the state in a file, which a simulation of the same scene with the same inputs has saved, or a run of it as its
 checkpoint: in any process, on any number of threads, with the same bits. Arrays that were looked at are gone.

 Errors: the file is missing, damaged or of another shot.

 What the caller promises:
 `path` ends with a zero; `error` is the address of a pointer or null.
 */
int32_t drapery_simulation_restore_file(struct drapery_simulation *simulation,
                                        const char *path,
                                        struct drapery_error **error);

/*
 Number of garments; 0 for what is no simulation.
 */
size_t drapery_simulation_garment_count(const struct drapery_simulation *simulation);

/*
 Name of a garment, counted from 0; null where there is none. Lives as long as the simulation.
 */
const char *drapery_simulation_garment_name(const struct drapery_simulation *simulation,
                                            size_t garment);

/*
 Number of bodies; 0 for what is no simulation.
 */
size_t drapery_simulation_body_count(const struct drapery_simulation *simulation);

/*
 Name of a body, counted from 0; null where there is none. Lives as long as the simulation.
 */
const char *drapery_simulation_body_name(const struct drapery_simulation *simulation,
                                         size_t body);

/*
 Number of warnings of the scene: what is suspicious but was accepted; 0 for what is no simulation.
 */
size_t drapery_simulation_warning_count(const struct drapery_simulation *simulation);

/*
 A warning, counted from 0; null where there is none. Lives as long as the simulation.
 */
const char *drapery_simulation_warning(const struct drapery_simulation *simulation,
                                       size_t warning);

/*
 Gives the positions of a garment at the present state: three numbers for each point in the order of its mesh, in metres with
 Y up. The array lives until the simulation advances, is restored or is freed; `point_count` counts points, not numbers.

 What the caller promises:
 `positions` and `point_count` are addresses or null, `error` is that of a pointer or null.
 */
int32_t drapery_simulation_positions(const struct drapery_simulation *simulation,
                                     size_t garment,
                                     const double **positions,
                                     size_t *point_count,
                                     struct drapery_error **error);

/*
 Gives the velocities of a garment at the present state in metres per second, as drapery_simulation_positions gives its
 positions.

 What the caller promises:
 `velocities` and `point_count` are addresses or null, `error` is that of a pointer or null.
 */
int32_t drapery_simulation_velocities(const struct drapery_simulation *simulation,
                                      size_t garment,
                                      const double **velocities,
                                      size_t *point_count,
                                      struct drapery_error **error);

/*
 Gives the faces of a garment: the number of corners of each, and the point of each corner, counter-clockwise seen from
 outside. The arrays live as long as the simulation.

 What the caller promises:
 The places are addresses or null, `error` is that of a pointer or null.
 */
int32_t drapery_simulation_faces(const struct drapery_simulation *simulation,
                                 size_t garment,
                                 const uint32_t **face_counts,
                                 size_t *face_count,
                                 const uint32_t **corners,
                                 size_t *corner_count,
                                 struct drapery_error **error);

/*
 Number of things that were counted on the way to the present frame, such as steps that were tried again; 0 at the start.
 */
size_t drapery_simulation_metric_count(const struct drapery_simulation *simulation);

/*
 Gives what was counted, numbered from 0: its name, which lives until the simulation advances, is restored or is freed, and
 how many there were. Returns false where there is none. The names are explained in docs/reference/counts.md.

 What the caller promises:
 `name` and `value` are addresses or null.
 */
bool drapery_simulation_metric(const struct drapery_simulation *simulation,
                               size_t metric,
                               const char **name,
                               uint64_t *value);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* DRAPERY_H */
